"""Builds the C core; everything else about the project stands in pyproject.toml."""

from setuptools import setup

setup(
    cffi_modules=["tinyekf_py/_core_build.py:ffibuilder"],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)

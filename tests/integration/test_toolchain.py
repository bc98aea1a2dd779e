"""What the toolchain's steps refuse, each with one line: wrong words, a missing tool, a full disk, a broken download.

What they do when all is well takes minutes: `make board`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

TOOLCHAIN = Path(__file__).resolve().parents[2] / "toolchain"
STEPS = sorted(path.name for path in TOOLCHAIN.glob("*.sh") if path.name != "step.sh")
TOOLS = {
    "cross-build.sh": "arm-linux-gnueabihf-gcc",
    "debian-package.sh": "dpkg-buildpackage",
    "board-root.sh": "mmdebstrap",
    "emulated-board.sh": "unshare",
    "deploy.sh": "ssh",
    "setup-host.sh": "apt-get",
}


def step(name: str, *words: str, build: Path, wrapped: tuple[str, ...] = (), **environment: str) -> tuple[int, str]:
    """Run a step; its exit status and what it said on standard error."""
    ended = subprocess.run(
        [*wrapped, str(TOOLCHAIN / name), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "BOARD_BUILD": str(build), **environment},
        stdin=subprocess.DEVNULL,
        check=False,
    )
    return ended.returncode, ended.stderr


def is_one_line(step_name: str, said: str) -> bool:
    return said.startswith(f"{step_name}: ") and said.count("\n") == 1 and said.endswith("\n")


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder with every program of this machine, from which a test takes one away."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for place in ("/usr/bin", "/usr/sbin", "/bin", "/sbin"):
        for program in Path(place).iterdir():
            link = folder / program.name
            if not link.is_symlink():
                link.symlink_to(program)
    return folder


@pytest.fixture
def need_tools() -> None:
    """Skip, in CI fail, where the steps' own tools are not installed."""
    missing = [tool for tool in TOOLS.values() if shutil.which(tool) is None]
    if missing or os.getuid() != 0:
        why = f"needs root and {', '.join(missing) or 'all tools'}: sudo toolchain/setup-host.sh"
        if os.environ.get("CI"):
            pytest.fail(why)
        pytest.skip(why)


@pytest.fixture
def small_disk(tmp_path: Path, need_tools: None) -> Iterator[Path]:
    """A folder with room for 2 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "small-disk", folder], check=True)
    yield folder
    subprocess.run(["umount", folder], check=True)


@pytest.mark.parametrize("name", STEPS)
def test_a_step_says_what_it_does(name: str, tmp_path: Path) -> None:
    ended = subprocess.run([TOOLCHAIN / name, "--help"], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert ended.stdout.startswith(f"usage: {name}")
    assert len(ended.stdout.splitlines()) > 3
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", STEPS)
def test_a_step_refuses_words_it_does_not_know(name: str, tmp_path: Path) -> None:
    status, said = step(name, "--fast", build=tmp_path)
    assert status == 2
    assert is_one_line(name, said), said
    assert "--fast" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["cross-build.sh", "debian-package.sh", "board-root.sh", "emulated-board.sh"])
def test_a_step_refuses_a_board_it_does_not_know(name: str, tmp_path: Path) -> None:
    status, said = step(name, "riscv64", build=tmp_path)
    assert status == 2
    assert is_one_line(name, said), said
    assert "riscv64" in said


@pytest.mark.parametrize(
    "words", [(), ("board",), ("@board",), ("me@board", "me@other"), ("--ssh-config", "none", "a@b")]
)
def test_a_deployment_wants_one_user_at_one_board(words: tuple[str, ...], tmp_path: Path) -> None:
    status, said = step("deploy.sh", *words, build=tmp_path)
    assert status == 2
    assert is_one_line("deploy.sh", said), said


@pytest.mark.parametrize(("name", "tool"), TOOLS.items())
def test_a_step_names_the_tool_that_is_missing(
    name: str, tool: str, tmp_path: Path, tools: Path, need_tools: None
) -> None:
    (tools / tool).unlink(missing_ok=True)
    words = ("me@board",) if name == "deploy.sh" else ()
    status, said = step(name, *words, build=tmp_path / "build", PATH=str(tools))
    assert status == 1
    assert is_one_line(name, said), said
    assert tool in said


@pytest.mark.parametrize("name", ["cross-build.sh", "debian-package.sh", "board-root.sh", "emulated-board.sh"])
def test_a_step_refuses_a_full_disk_before_it_begins(name: str, small_disk: Path) -> None:
    status, said = step(name, build=small_disk)
    assert status == 1
    assert is_one_line(name, said), said
    assert "MB are free" in said


def test_a_build_folder_that_cannot_be_made_is_refused(tmp_path: Path, need_tools: None) -> None:
    (tmp_path / "file").touch()
    status, said = step("cross-build.sh", build=tmp_path / "file" / "build")
    assert status == 1
    assert is_one_line("cross-build.sh", said), said


@pytest.mark.parametrize("name", ["board-root.sh", "cross-build.sh"])
def test_a_broken_download_leaves_nothing_half_made(name: str, tmp_path: Path, need_tools: None) -> None:
    """Nothing listens where the mirror is said to be."""
    status, said = step(name, build=tmp_path, BOARD_MIRROR="http://127.0.0.1:9/debian")
    assert status == 1
    assert is_one_line(name, said), said
    assert [path.name for path in tmp_path.iterdir()] == ["log"]


def test_a_board_that_does_not_answer_is_refused(tmp_path: Path, need_tools: None) -> None:
    config = tmp_path / "ssh_config"
    config.write_text("Host board\n  HostName 127.0.0.1\n  Port 9\n", "utf-8")
    status, said = step("deploy.sh", "--ssh-config", str(config), "me@board", build=tmp_path / "build")
    assert status == 1
    assert is_one_line("deploy.sh", said), said

"""`tinyekf export`: a recording as tables for other tools.

A replay gives samples and estimates (`command`); `tables` names their columns; `csv_tables`, `parquet_tables` and
`mcap_channels` write them.
"""

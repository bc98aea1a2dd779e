"""Evaluation: recordings with truth, times methods, gives a table and pictures.

`decoded` reads a recording once, `methods` runs what is to be judged on it (the fusion's methods, single sensors as
`sensor_readers`, other people's filters as `peers`), `measures` judges it against the `truth`. A `job` is one
recording with all its methods; `spread` runs jobs in parallel processes or on a cluster; `table` and `pictures` show
what came out. `paper` repeats the experiment of the 2019 paper.
"""

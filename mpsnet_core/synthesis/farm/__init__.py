"""Make a job's samples in parallel, by processes on this machine or on a Dask cluster."""

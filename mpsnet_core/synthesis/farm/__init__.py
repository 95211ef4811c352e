"""Many processes, on this machine or on a Dask cluster, that make a job's samples, each once."""

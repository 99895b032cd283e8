"""ROS 2 nodes: parameters, topics and services around the numerics, and nothing else."""

import os

# Small matrices on a loaded machine: a second BLAS thread only takes the CPU from other nodes.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

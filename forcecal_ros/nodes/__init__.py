"""ROS 2 nodes: parameters, topics and services around the numerics, and nothing else."""

import os

# The matrices are small: a second BLAS thread would only take the processor from other nodes.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

"""How many threads NumPy's OpenBLAS gets in programs of ours: none, as nothing large is computed by it.

It takes one for each core as it is loaded; where the system has none to give, it interrupts the process as Ctrl-C does.
A process that is to be forked has no threads, either.
"""

NO_MORE_THREADS = {"OPENBLAS_NUM_THREADS": "1"}  # in the environment, before NumPy is imported

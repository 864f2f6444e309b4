"""Stands in for `volsplat` and its interpreter: has command_forker.py fork the program, and ends with its status.

Run as `python -IS stand_in.py SOCKET WORDS`: needs nothing but the standard library, and as little of it as can be.
"""

import json
import os
import socket
import sys

with socket.socket(socket.AF_UNIX) as forker:
    forker.connect(sys.argv[1])
    request = {"words": sys.argv[2:], "folder": os.getcwd(), "environment": dict(os.environ)}
    data = json.dumps(request).encode()
    socket.send_fds(forker, [len(data).to_bytes(8, "big")], [0, 1, 2])
    forker.sendall(data)
    said = forker.recv(16, socket.MSG_WAITALL)  # which process it is, and, once that has ended, by what
status = int.from_bytes(said[8:], "big", signed=True)
sys.exit("what forks commands has ended" if len(said) < 16 else status if status >= 0 else 128 - status)

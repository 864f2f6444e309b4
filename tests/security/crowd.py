"""So many strangers who connect, say nothing and stay: a program of its own, with more descriptors than others have.

It takes turns with the addresses, says how many are connected, and goes when its standard input ends.
"""

import resource
import socket
import sys

from volsplat.protocol.wire.addresses import parse_address

SPARE = 64  # descriptors of the program itself


def main() -> None:
    count, *places = sys.argv[1:]
    most = int(count) + SPARE
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    addresses = [parse_address(place) for place in places]
    strangers = [socket.create_connection(addresses[number % len(addresses)]) for number in range(int(count))]
    print(len(strangers), flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()

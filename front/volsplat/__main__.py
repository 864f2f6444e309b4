"""`python -m volsplat`: the command, also where its script is in no folder of PATH."""

from volsplat.client.command.cli import main

if __name__ == "__main__":
    main()

"""The exit statuses of every volsplat program."""

EXIT_FAILED = 1
EXIT_BAD_INPUT = 2  # a person must put it right
EXIT_INTERRUPTED = 130  # as a shell says it of SIGINT
EXIT_TERMINATED = 143  # and of SIGTERM

"""What every volsplat program is as a process: its options, how it ends, what it prints and logs."""

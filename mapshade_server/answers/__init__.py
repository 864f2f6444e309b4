"""What is asked of a volume beside frames: its description, values, slices, probes, counts and sums."""

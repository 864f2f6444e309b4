"""A cluster: its servers brought up, remembered, asked after and ended."""

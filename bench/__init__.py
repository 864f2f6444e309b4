"""The benchmarks, as commands: `volsplat bench --help`. May import every other part; no part imports it."""

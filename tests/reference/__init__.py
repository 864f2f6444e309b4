"""The paper's equations in plain float64 torch. These modules import nothing of ours but `volsplat.protocol`."""

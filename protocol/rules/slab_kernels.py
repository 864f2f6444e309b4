"""The kernels of step G: where they are cut, and those that have weights below 0.

The latter are (1 - q)^2 (c0 + c1 q + c2 q^2 + ...), q = (r / radius)^2: of all such the ones that restore waves best on
a cubic grid, up to its Nyquist frequency, in the mean over directions and places (tests/reference/slab_kernels.py). A
radial kernel cannot pass through every voxel and be smooth between them; these leave waves what they are, which is what
blur takes away (quasi-interpolation: Condat and Moeller 2011).

The default one lies between blur and ringing, as Mitchell and Netravali's (1988) does among cubic splines: a mean of
crisp, with a weight of 0.8, and of the bell (1 - q)^4, each of which integrates to 1.
"""

from volsplat.protocol.description.scene import SlabKernel

# Voxels. Narrower kernels without weights below 0 blur less, down to about 1.5; but the less even their sums, the more
# waves of the voxels' own steps are left on what is smooth. Sums have room for 1.3 times the mean.
SLAB_RADIUS = {
    SlabKernel.BALANCED: 2.0,
    SlabKernel.CRISP: 2.0,
    SlabKernel.QUASI_INTERPOLATING: 3.0,
    SlabKernel.GAUSSIAN: 2.0,
    SlabKernel.BSPLINE: 1.75,
    SlabKernel.KAISER_BESSEL: 1.75,
    SlabKernel.CONE: 1.75,
}
COEFFICIENTS = {
    SlabKernel.BALANCED: (0.6903, -3.0395, 3.7758, -0.2857, -1.9475),
    SlabKernel.CRISP: (0.7955, -3.6648, 4.6524, -0.3571, -2.4344),
    SlabKernel.QUASI_INTERPOLATING: (0.7479, -8.0007, 29.0489, -50.7137, 47.0686, -22.0338, 4.0465),
}

# Voxels: further away no weight is above 0.
INNER_RADIUS = SLAB_RADIUS | {SlabKernel.BALANCED: 1.3, SlabKernel.CRISP: 1.25}

# Of what weights sum to within: where they sum to less, nothing is known. Weights below 0 leave the more of the others'
# error, the less all sum to.
LEAST_KNOWN = dict.fromkeys(SlabKernel, 1 / 16) | dict.fromkeys(COEFFICIENTS, 3 / 16)
# How far a density may leave those of the voxels around, as a share of what lies between the least and the greatest of
# these: what the weights below 0 sum to, by what all sum to.
GREATEST_OVERSHOOT = 4.0
OVERSHOOT = dict.fromkeys(SlabKernel, 0.0) | {
    SlabKernel.BALANCED: 0.4,
    SlabKernel.CRISP: 0.6,
    SlabKernel.QUASI_INTERPOLATING: 1.4,
}

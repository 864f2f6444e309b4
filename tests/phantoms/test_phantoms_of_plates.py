"""The phantoms of the paper's plates: what is published of them is found again in their voxels."""

import math

import pytest
import torch
from torch import Tensor

import tolerances
from volsplat.client.phantoms import galaxy, make_phantom, p_orbital, protein, rna, seismic, structure_factors
from volsplat.client.phantoms.molecule import BAND, CLASSES, RADII, Molecule, elements
from volsplat.client.phantoms.rna_geometry import RISE, TWIST
from volsplat.mapshade_server.readers.molecules import atom_density
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Vector, cross, dot, length, minus, normalised, plus, scaled


def places_of(geometry: Geometry, indices: Tensor) -> Tensor:
    """Physical places (n, 3) of voxels, given as (k, j, i)."""
    return indices.flip(1) * torch.tensor(geometry.spacing) + torch.tensor(geometry.origin)


# p-orbital


def test_slater_orbitals_are_normalised_and_mix_into_a_normalised_bond() -> None:
    overlap = p_orbital.overlaps()
    assert overlap.diagonal().tolist() == pytest.approx([1.0] * 3, abs=tolerances.ORBITAL_OVERLAP)
    assert abs(overlap[1, 2]) < tolerances.ORBITAL_OVERLAP  # 4s and 3d of one atom
    c = torch.tensor(p_orbital.bonding_coefficients(), dtype=torch.float64)
    assert float(c @ overlap @ c) == pytest.approx(1.0, abs=tolerances.ROUNDING)


def test_the_orbital_holds_one_electron_and_is_round_about_the_bond() -> None:
    values, geometry = make_phantom("p-orbital")
    assert geometry.dims == (64, 64, 64)
    assert values.sum().item() * math.prod(geometry.spacing) == pytest.approx(1.0, abs=tolerances.ELECTRON_IN_VIEW)
    for alike in (values.transpose(1, 2), values.flip(1), values.flip(2)):
        torch.testing.assert_close(alike, values)


def test_electrons_are_shared_between_the_lobes() -> None:
    """Between the atoms there is more than the parts of the wave have alone; the p-orbital's node is at chlorine."""
    rho2, z = torch.zeros(()), torch.tensor(0.0)
    parts = [c * o.value(rho2, z) for c, o in zip(p_orbital.bonding_coefficients(), p_orbital.BASIS, strict=True)]
    assert float(sum(parts)) ** 2 > 1.5 * sum(float(part) ** 2 for part in parts)

    values, geometry = make_phantom("p-orbital", size=(65, 65, 65))
    axis = values[:, 32, 32]
    heights = geometry.origin[2] + torch.arange(65) * geometry.spacing[2]
    chlorine, copper = (int((heights - z).abs().argmin()) for z in (p_orbital.CHLORINE, p_orbital.COPPER))
    outer, inner = axis[:chlorine].max(), axis[chlorine : chlorine + 12].max()
    assert axis[chlorine] < 0.05 * outer < outer < inner  # the lobe towards copper is the larger one
    assert axis[chlorine + 4 : copper - 1].min() > 0.3 * inner  # and nothing parts it from copper


# RNA


def strands(atoms: Molecule) -> list[list[int]]:
    """What is bonded together."""
    neighbours: dict[int, list[int]] = {n: [] for n in range(len(atoms.elements))}
    for one, other in atoms.bonds:
        neighbours[one].append(other)
        neighbours[other].append(one)
    left, found = set(neighbours), []
    while left:
        reached = [left.pop()]
        for atom in reached:
            fresh = [n for n in neighbours[atom] if n in left]
            left.difference_update(fresh)
            reached += fresh
        found.append(sorted(reached))
    return found


def test_the_rna_is_two_strands_of_which_one_is_nicked() -> None:
    """The diffraction data are only right together if every nucleotide's O3' meets the next one's phosphorus."""
    atoms = rna.rna_atoms()
    phosphorus = sorted(sum(atoms.elements[n] == "P" for n in strand) for strand in strands(atoms))
    assert phosphorus == [len(rna.T_ARM) - 1, len(rna.ACCEPTOR_ARM) - 1, len(rna.PAIRS) - 1]
    lengths = [float((atoms.places[a] - atoms.places[b]).norm()) for a, b in atoms.bonds]
    low, high = tolerances.CARBON_BOND
    assert low < min(lengths) and max(lengths) < high


def test_the_helix_of_the_rna_is_found_in_its_voxels() -> None:
    """Phosphorus is densest: its peaks wind about z to the right, and once in 11 times 2.81 Å."""
    values, geometry = make_phantom("rna", size=(96, 96, 96))
    highest = torch.nn.functional.max_pool3d(values[None, None], 3, stride=1, padding=1)[0, 0]
    peaks = places_of(geometry, torch.nonzero((values == highest) & (values > 11)))
    assert len(peaks) == sum(element == "P" for element in rna.rna_atoms().elements)
    assert torch.hypot(peaks[:, 0], peaks[:, 1]).mean().item() == pytest.approx(8.71, abs=0.2)
    angle = torch.atan2(peaks[:, 1], peaks[:, 0])
    apart = torch.cdist(peaks, peaks)
    upper, lower = torch.nonzero((apart > 5) & (apart < 7) & (peaks[:, None, 2] > peaks[None, :, 2])).unbind(1)
    assert len(upper) == len(peaks) - 3  # neighbours in a strand; between the strands it is farther
    turns = torch.remainder(angle[upper] - angle[lower] + math.pi, 2 * math.pi) - math.pi
    rise = (peaks[upper, 2] - peaks[lower, 2]).mean().item()
    pitch = rise * 2 * math.pi / turns.mean().item()
    assert rise == pytest.approx(RISE, rel=tolerances.HELIX_PITCH)
    assert pitch == pytest.approx(360 / TWIST * RISE, rel=tolerances.HELIX_PITCH)  # above 0: to the right


def test_the_rna_holds_the_electrons_of_its_atoms() -> None:
    values, geometry = make_phantom("rna")
    atoms = rna.rna_atoms()
    widths = (atoms.radii / 2).clamp(min=0.7 * geometry.reference_spacing)
    expected = (atoms.electrons * (2 * math.pi) ** 1.5 * widths**3).sum().item()
    assert values.sum().item() * math.prod(geometry.spacing) == pytest.approx(expected, rel=tolerances.VOXEL_SUM)


# protein


def test_a_built_helix_is_the_alpha_helix_of_the_books() -> None:
    built = protein.built_helix("AAAAAAAAAAAA")
    points = [residue["CA"] for residue in built]
    bends = [
        normalised(plus(minus(a, scaled(b, 2)), c)) for a, b, c in zip(points, points[1:], points[2:], strict=False)
    ]
    turn = math.degrees(math.acos(dot(bends[3], bends[4])))
    axis = normalised(cross(bends[3], bends[4]))
    rise = dot(minus(points[9], points[3]), axis) / 6
    assert turn == pytest.approx(100.0, abs=tolerances.IDEAL_HELIX_DEGREES)
    assert rise == pytest.approx(1.5, abs=tolerances.IDEAL_HELIX_RISE)  # above 0: it is right-handed
    assert 2.7 < length(minus(built[3]["O"], built[7]["N"])) < 3.3  # Å, its hydrogen bond
    residue = built[5]
    to_n, to_c, to_cb = (minus(residue[name], residue["CA"]) for name in ("N", "C", "CB"))
    assert dot(cross(to_n, to_c), to_cb) > 0  # an L-amino acid


def test_the_helices_lie_where_they_are_said_to() -> None:
    for helix in protein.HELICES:
        residues = protein.placed(helix, protein.built_helix(helix.sequence))
        assert len(residues) == len(helix.sequence)
        first: Vector = minus(residues[0]["CA"], helix.start)
        assert length(first) == pytest.approx(2.28, abs=0.05)  # the radius of C-alpha in an alpha helix
        assert dot(normalised(first), helix.facing) > 0.999
        along = minus(residues[-1]["CA"], residues[0]["CA"])
        assert dot(along, helix.direction) == pytest.approx(1.5 * (len(residues) - 1), rel=0.05)


def test_the_protein_has_its_elements_in_bands() -> None:
    values, geometry = make_phantom("protein")
    atoms = protein.protein_atoms()
    present = {CLASSES[band] for band in set((values[values > 0] // BAND).tolist())}
    assert present == {"bond", "C", "N", "O", "S"}
    index = ((atoms.places - torch.tensor(geometry.origin)) / torch.tensor(geometry.spacing)).round().long()
    at_atoms = values[index[:, 2], index[:, 1], index[:, 0]] // BAND
    right = [CLASSES[band] == element for band, element in zip(at_atoms.tolist(), atoms.elements, strict=True)]
    assert sum(right) > 0.98 * len(right)


def test_elements_are_drawn_as_the_reader_of_atoms_draws_them() -> None:
    """One scene must suit both."""
    assert (CLASSES, BAND) == (atom_density.CLASSES, atom_density.BAND)
    atoms = protein.protein_atoms()
    step = 0.8
    geometry = Geometry(
        dims=(40, 44, 48),
        index_to_physical=((step, 0.0, 0.0), (0.0, step, 0.0), (0.0, 0.0, step)),
        origin=(-16, -17, -19),
    )
    ours = elements(atoms, geometry, 1.0)
    read = atom_density.Atoms(
        places=atoms.places.numpy(),
        radii=atoms.radii.numpy(),
        heights=atoms.electrons.numpy(),
        classes=torch.tensor([CLASSES.index(element) for element in atoms.elements]).numpy(),
        alternatives=torch.zeros(len(atoms.elements), dtype=torch.int64).numpy(),
    )
    theirs = torch.from_numpy(atom_density.AtomGrid(read, geometry).elements(geometry.box))
    same = (ours // BAND == theirs // BAND) & ((ours > 0) == (theirs > 0))
    assert same.double().mean().item() >= tolerances.SAME_ELEMENT_VOXELS


def test_radii_are_those_that_the_reader_of_atoms_has() -> None:
    gemmi = pytest.importorskip("gemmi")
    for element, radius in RADII.items():
        assert gemmi.Element(element).covalent_r == pytest.approx(radius, abs=0.005)


# structure factors


@pytest.fixture(scope="module")
def factors() -> Tensor:
    """F(h, k, l) for h, k, l from -12 to 12."""
    return structure_factors.structure_factors((25, 25, 25))


def test_structure_factors_are_the_sum_over_the_atoms(factors: Tensor) -> None:
    atoms = protein.protein_atoms()
    cell = torch.tensor(structure_factors.CELL, dtype=torch.float64)
    shares = atoms.places / cell + torch.tensor(structure_factors.PLACE_IN_CELL, dtype=torch.float64)
    in_cell = [shares * torch.tensor(s) + torch.tensor(t) for s, t in structure_factors.OPERATIONS]
    step = cell / 50  # of the density's grid, at which atoms are as narrow as it can hold
    shaking = structure_factors.TEMPERATURE_FACTOR / (8 * math.pi**2)
    widths = torch.maximum(torch.tensor(shaking).sqrt(), structure_factors.NARROWEST * step)
    total = 4 * atoms.electrons.sum().item()
    scale = factors[12, 12, 12].real.item() / total
    for h, k, l in ((0, 0, 2), (3, 1, 4), (-5, 2, 1), (4, -7, -6), (1, 8, 3)):  # noqa: E741
        index = torch.tensor((h, k, l), dtype=torch.float64)
        falls = torch.exp(-2 * math.pi**2 * ((index / cell * widths) ** 2).sum())
        turns = torch.stack([2 * math.pi * (places @ index) for places in in_cell])
        expected = falls * (atoms.electrons * torch.complex(turns.cos(), turns.sin())).sum()
        got = factors[l + 12, k + 12, h + 12] / scale
        assert abs(complex(got) - complex(expected)) < tolerances.ALIASED_AMPLITUDE * total


def test_structure_factors_have_the_symmetry_of_their_crystal(factors: Tensor) -> None:
    total = factors.abs().max().item()
    torch.testing.assert_close(factors.flip(0, 1, 2), factors.conj(), rtol=0, atol=1e-5 * total)  # Friedel's law
    for axis in range(3):
        intensities = factors.abs()
        torch.testing.assert_close(intensities.flip(axis), intensities, rtol=0, atol=1e-5 * total)
    for along_axis in (factors[12, 12, :], factors[12, :, 12], factors[:, 12, 12]):
        odd = along_axis[1::2]  # of a screw axis, absent
        assert odd.abs().max() < 1e-5 * total < along_axis[0::2].abs().median()


def test_phase_and_amplitude_are_in_the_bytes(factors: Tensor) -> None:
    values, geometry = make_phantom("structure-factors", size=(25, 25, 25))
    assert geometry.spacing == pytest.approx([1 / edge for edge in structure_factors.CELL])
    degrees = torch.rad2deg(torch.angle(factors)) % 360
    clear = (degrees % 45 - 22.5).abs() < 22.4  # well within a sector
    assert torch.equal((values // 32)[clear], (degrees // 45).to(torch.uint8)[clear])
    level = (values % 32).long()
    assert level[12, 12, 12] == 31 and level.min() == 0
    order = factors.abs().flatten().argsort()
    assert (level.flatten()[order].diff() >= 0).all()


# galaxy


@pytest.fixture(scope="module")
def spectra() -> tuple[Tensor, Tensor]:
    """Of the default cube: brightness summed over all channels, and the mean channel, both (y, x)."""
    values, geometry = make_phantom("galaxy")
    assert geometry.dims == (100, 100, 80)
    bright = values.where(values > 5 * galaxy.NOISE, 0.0)
    total = bright.sum(dim=0)
    channels = torch.arange(80)[:, None, None] - 39.5
    return total, (bright * channels).sum(dim=0) / total.clamp(min=1e-6)


def test_the_receding_side_of_the_galaxy_is_the_one_that_is_said(spectra: tuple[Tensor, Tensor]) -> None:
    """Along the major axis the velocity is that of the rotation curve, with the sign of the side."""
    _, mean = spectra
    for radius in (8.0, 14.0, 20.0):
        x, y = radius * math.cos(galaxy.POSITION_ANGLE), radius * math.sin(galaxy.POSITION_ANGLE)
        for side in (1, -1):
            i, j = round(49.5 + side * x), round(49.5 + side * y)
            at = (torch.tensor(i - 49.5), torch.tensor(j - 49.5))
            expected = galaxy.line_of_sight_velocity(*at).item()
            assert side * expected > 50
            assert mean[j, i].item() == pytest.approx(expected / galaxy.CHANNEL_WIDTH, abs=tolerances.CHANNEL)


def test_the_galaxy_is_the_same_from_both_sides_but_for_the_sign_of_its_velocity(
    spectra: tuple[Tensor, Tensor],
) -> None:
    total, mean = spectra
    seen = (total > 0.2 * total.max()) & (total.flip(0, 1) > 0.2 * total.max())
    assert seen.sum() > 500
    assert (mean + mean.flip(0, 1))[seen].abs().max() < 5 * tolerances.CHANNEL


def test_the_rotation_is_flat_far_out_and_nothing_turns_in_the_middle() -> None:
    speeds = galaxy.rotation_speed(torch.tensor([0.0, 20.0, 40.0, 1e6]))
    assert speeds[0] == 0 and speeds[3].item() == pytest.approx(galaxy.FLAT_ROTATION, rel=1e-4)
    assert 0.7 < speeds[1] / speeds[3] < speeds[2] / speeds[3] < 1


def test_the_outskirts_of_the_galaxy_turn_its_axis() -> None:
    """The line of no velocity, the minor axis, is bent where the disc is warped."""
    angles = torch.deg2rad(torch.arange(0.0, 180.0, 0.25))
    bends = []
    for radius in (10.0, 30.0):
        speed = galaxy.line_of_sight_velocity(radius * torch.cos(angles), radius * torch.sin(angles))
        bends.append(angles[speed.abs().argmin()].item() - galaxy.POSITION_ANGLE)
    assert bends[0] == pytest.approx(math.pi / 2, abs=0.01) and bends[1] > bends[0] + math.radians(3)


# seismic


def test_the_wavelet_peaks_at_its_frequency_and_adds_up_to_nothing() -> None:
    step = 0.0005
    times = (torch.arange(4000, dtype=torch.float64) - 2000) * step
    wavelet = seismic.ricker(times)
    spectrum = torch.fft.rfft(wavelet).abs()
    assert spectrum.argmax().item() / (4000 * step) == pytest.approx(seismic.PEAK_FREQUENCY, abs=0.5)
    assert abs(wavelet.sum().item()) < tolerances.ROUNDING * 4000 and seismic.ricker(torch.zeros(())) == 1


def test_reflections_are_signed_and_bounded_by_the_impedances() -> None:
    most = (seismic.GREATEST_IMPEDANCE - seismic.LEAST_IMPEDANCE) / (
        seismic.GREATEST_IMPEDANCE + seismic.LEAST_IMPEDANCE
    )
    boundaries = seismic.layer_boundaries(0)
    depths, reflections = zip(*boundaries, strict=True)
    assert max(map(abs, reflections)) < most and min(reflections) < 0 < max(reflections)
    steps = [low - high for high, low in zip(depths, depths[1:], strict=False)]
    assert seismic.THINNEST <= min(steps) and max(steps) <= seismic.THICKEST
    values, geometry = make_phantom("seismic")
    assert geometry.dims == (64, 64, 64) and values.dtype == torch.float32
    assert abs(values.mean().item()) < 0.01 < values.std().item()


def test_a_fault_throws_the_layers_down_by_what_is_said() -> None:
    """The traces on both sides of the first fault, slid along each other, match at the throw and the fold between."""
    values, _ = make_phantom("seismic")
    down = values.flip(0)[:, 32, :]  # the ground first, on the line y = 0.5
    near, far = down[:, 9], down[:, 27]  # x = -22.5 and -4.5: apart from the fault between samples 16 and 48
    window = near[20:44]
    shifts = list(range(-14, 15))
    match = [float(torch.corrcoef(torch.stack((window, far[20 + s : 44 + s])))[0, 1]) for s in shifts]
    y = torch.tensor(0.5)
    fold = (seismic._fold(torch.tensor(-4.5), y) - seismic._fold(torch.tensor(-22.5), y)).item()
    assert max(match) > 0.9
    assert shifts[match.index(max(match))] == pytest.approx(seismic.FAULTS[0].throw + fold, abs=0.6)

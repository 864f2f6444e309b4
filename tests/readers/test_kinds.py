"""The kind of data that each reader states, and what of the file states it: in files made here, and in real ones."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from support.files.dicom_files import MR, PET, series
from support.files.map_files import map_file, map_header
from support.files.opened import described
from support.files.reflection_files import mtz
from support.files.volume_files import written
from volsplat.client.command.phantom_command import phantom
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.medicine.modality import kind_of_modality
from volsplat.mapshade_server.readers.medicine.nrrd_header import header_of_file
from volsplat.mapshade_server.readers.molecules.map_kinds import is_difference, kind_of_names
from volsplat.mapshade_server.readers.reading.parts import PartNeeded
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.text.errors import BadInput

VALUES = np.arange(5 * 6 * 7, dtype=np.uint8).reshape(5, 6, 7)
SIGNED = (np.arange(5 * 6 * 7, dtype=np.float32) - 100).reshape(5, 6, 7)


def kind_of(name: str | Path) -> tuple[Kind, str]:
    one = described(name)
    return one.kind, one.kind_from


# Medicine


@pytest.mark.parametrize(
    ("sop_class", "modality", "kind"),
    [(MR, "MR", Kind.MR), (MR, "CT", Kind.CT), (PET, "PT", Kind.SCAN), (MR, "OT", Kind.UNKNOWN)],
)
def test_dicom_states_its_modality(tmp_path: Path, sop_class: str, modality: str, kind: Kind) -> None:
    folder = series(tmp_path, VALUES.astype(np.uint16), kind=sop_class, Modality=modality)
    assert kind_of(folder) == (kind, f"modality {modality}" if kind != Kind.UNKNOWN else "")


def test_a_label_map_in_dicom_is_no_scan() -> None:
    assert kind_of_modality("SEG")[0] is Kind.LABELS


def nifti(path: Path, intent: int = 0) -> Path:
    written(path, VALUES)
    raw = bytearray(path.read_bytes())
    struct.pack_into("<h", raw, 68, intent)
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize(
    ("intent", "kind", "values"),
    [
        (0, Kind.UNKNOWN, "value"),
        (3, Kind.STATISTIC_MAP, "t statistic"),
        (5, Kind.STATISTIC_MAP, "z statistic"),
        (24, Kind.STATISTIC_MAP, "statistic"),
        (1002, Kind.LABELS, "label"),
    ],
)
def test_nifti_states_its_intent(tmp_path: Path, intent: int, kind: Kind, values: str) -> None:
    described = open_volume(str(nifti(tmp_path / "volume.nii", intent))).description
    assert (described.kind, described.density_name) == (kind, values)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("sub-01_T1w.nii", Kind.MR),
        ("sub-01_ses-2_ct.nii", Kind.CT),
        ("sub-01_dseg.nii", Kind.LABELS),
        ("sub-01_unheard.nii", Kind.UNKNOWN),
        ("T1w.nii", Kind.UNKNOWN),
    ],
)
def test_a_name_by_bids_states_the_kind(tmp_path: Path, name: str, kind: Kind) -> None:
    assert kind_of(nifti(tmp_path / name))[0] is kind


@pytest.mark.parametrize(
    ("notes", "kind"),
    [
        (json.dumps({"Modality": "MR"}), Kind.MR),
        (json.dumps({"Modality": 3}), Kind.UNKNOWN),
        ("[1]", Kind.UNKNOWN),
        ("{", Kind.UNKNOWN),
        ("\xff", Kind.UNKNOWN),
    ],
)
def test_the_notes_that_converters_write_beside_a_nifti_state_the_kind(tmp_path: Path, notes: str, kind: Kind) -> None:
    (tmp_path / "scan.json").write_text(notes, encoding="latin-1")
    told = kind_of(nifti(tmp_path / "scan.nii"))
    assert told == (kind, "modality MR in scan.json" if kind is Kind.MR else "")


@pytest.mark.parametrize(("modality", "kind"), [("MET_MOD_MR", Kind.MR), ("MET_MOD_OTHER", Kind.UNKNOWN)])
def test_metaimage_states_its_modality(tmp_path: Path, modality: str, kind: Kind) -> None:
    path = written(tmp_path / "volume.mhd", VALUES)
    path.write_text(
        f"Modality = {modality}\n".join(path.read_text(encoding="utf-8").split("NDims", 1)).replace(
            "\n =", "\nNDims =", 1
        )
    )
    assert kind_of(path)[0] is kind


def nrrd(path: Path, values: Voxels, fields: str) -> Path:
    sizes = " ".join(str(n) for n in values.shape[::-1])
    kind = {"uint8": "uchar", "float32": "float"}[values.dtype.name]
    head = f"NRRD0005\ntype: {kind}\ndimension: {values.ndim}\nsizes: {sizes}\nendian: little\nencoding: raw\n{fields}"
    path.write_bytes(f"{head.rstrip()}\n\n".encode() + values.tobytes())
    return path


def test_slicers_segments_are_labels_with_their_names_and_colours(tmp_path: Path) -> None:
    keys = """Segment0_Name:=liver
Segment0_LabelValue:=1
Segment0_Layer:=0
Segment0_Color:=0.5 0.25 1
Segment1_LabelValue:=7
Segment2_LabelValue:=3
Segment2_Layer:=1"""
    one = described(nrrd(tmp_path / "organs.seg.nrrd", VALUES, keys))
    assert (one.kind, one.kind_from) == (Kind.LABELS, "the segments in its header")
    assert one.bands == (Band("liver", 1.0, 1.0, (0.5, 0.25, 1.0)), Band("segment 1", 7.0, 7.0))


@pytest.mark.parametrize(
    ("layers", "left_out", "told"),
    [
        ({0: "1", 1: "1"}, "liver, tumour", "layer 1, but the file has layer 0 alone"),
        ({0: "0", 1: "3"}, "tumour", "layer 3, but the file has layer 0 alone"),
        ({0: "0"}, "", ""),
    ],
)
def test_segments_of_layers_that_the_file_lacks_are_told(
    tmp_path: Path, layers: dict[int, str], left_out: str, told: str
) -> None:
    names = {0: "liver", 1: "tumour"}
    keys = [f"Segment{n}_Name:={name}\nSegment{n}_LabelValue:={n + 1}" for n, name in names.items()]
    keys += [f"Segment{n}_Layer:={layer}" for n, layer in layers.items()]
    one = described(nrrd(tmp_path / "organs.seg.nrrd", VALUES, "\n".join(keys)))
    assert one.kind is Kind.LABELS
    assert [band.name for band in one.bands] == [name for name in names.values() if name not in left_out]
    lines = [line for line in one.warnings if "segments" in line]
    assert lines == ([f"the segments {left_out} are left out: they belong to {told}"] if told else [])


@pytest.mark.parametrize(
    ("written", "name"),
    [(r"left\\right", r"left\right"), (r"two\nlines", "two\nlines"), (r"a\\nb", r"a\nb"), ("a\\tb\\", "a\\tb\\")],
)
def test_escapes_in_keys_and_values_are_undone_as_the_format_says(tmp_path: Path, written: str, name: str) -> None:
    one = described(nrrd(tmp_path / "organs.seg.nrrd", VALUES, f"Segment0_Name:={written}"))
    assert one.bands == (Band(name, 1.0, 1.0),)


@pytest.mark.parametrize(
    ("line", "key", "value"),
    [
        ("http://example.org/name:=CT: head", "http://example.org/name", "CT: head"),
        ("a:b:=c:=d", "a:b", "c:=d"),
        ("see also: that:=this", "see also: that", "this"),
        (":a:=", ":a", ""),
        ("space:=lost", "space", "lost"),
    ],
)
def test_a_key_may_hold_colons_unless_a_field_stands_before_one_and_a_blank(
    tmp_path: Path, line: str, key: str, value: str
) -> None:
    header = header_of_file(nrrd(tmp_path / "v.nrrd", VALUES, line))
    assert header.pairs == {key: value}
    assert not header.fields.keys() - header_of_file(nrrd(tmp_path / "plain.nrrd", VALUES, "# none")).fields.keys()


@pytest.mark.parametrize(
    ("line", "name", "value"),
    [
        ("content: a:=b", "content", "a:=b"),
        ("Sample Units: g:=h", "sample units", "g:=h"),
        ('spaceunits: "mm"', "space units", '"mm"'),
        ("Centerings: cell:=cell", "centers", "cell:=cell"),
        ("units:x: y", "units", "x: y"),
        ("none of the format: a: b", "none of the format", "a: b"),
    ],
)
def test_what_stands_behind_a_field_is_its_own(tmp_path: Path, line: str, name: str, value: str) -> None:
    header = header_of_file(nrrd(tmp_path / "v.nrrd", VALUES, line))
    assert header.fields[name] == value and not header.pairs


def named_volumes(path: Path) -> list[str]:
    with pytest.raises(PartNeeded) as needed:
        open_volume(str(path))
    assert all(one.told.partition(": ")[2] in str(needed.value) for one in needed.value.parts)
    return [one.told.partition(": ")[2] for one in needed.value.parts]


@pytest.mark.parametrize("kinds", ["list domain domain domain", "vector domain domain domain"])
def test_layers_of_slicers_segments_are_named_by_what_is_in_them(tmp_path: Path, kinds: str) -> None:
    """A segment without a value has 1, one without a layer the layer of its number, as Slicer wrote them first."""
    keys = """Segment0_ID:=Segment_1
Segment0_Name:=liver
Segment1_ID:=Segment_2
Segment2_ID:=Segment_3
Segment2_Name:=tumour
Segment2_LabelValue:=2
Segment2_Layer:=0"""
    path = nrrd(tmp_path / "organs.seg.nrrd", np.stack([VALUES, VALUES[::-1]], axis=-1), f"kinds: {kinds}\n{keys}")
    assert named_volumes(path) == ["liver, tumour", "Segment_2"]
    assert described(f"{path}#0").bands == (Band("liver", 1.0, 1.0), Band("tumour", 2.0, 2.0))
    upper = open_volume(f"{path}#1")
    assert upper.description.bands == (Band("Segment_2", 1.0, 1.0),)
    np.testing.assert_array_equal(upper.read(upper.description.geometry.box), VALUES[::-1])


@pytest.mark.parametrize("kinds", ["list domain domain domain", "vector domain domain domain"])
def test_diffusion_weighted_volumes_are_named_by_their_gradients(tmp_path: Path, kinds: str) -> None:
    """A gradient of half the length has a quarter of the b-value, and one may be that of several volumes."""
    keys = """modality:=DWMRI
DWMRI_b-value:=1000
DWMRI_gradient_0000:=0 0 0
DWMRI_NEX_0000:=2
DWMRI_gradient_0002:=0 -1.2 1.6
DWMRI_gradient_0003:= 1  0  0
DWMRI_gradient_0004:=n/a n/a n/a
DWMRI_gradient_0005:=1e308 1.4e308 1e308
DWMRI_gradient_0006:=1 1 1"""
    values = np.stack([VALUES] * 3 + [VALUES[::-1]] + [VALUES] * 2, axis=-1)
    path = nrrd(tmp_path / "dwi.nrrd", values, f"kinds: {kinds}\n{keys}")
    gradients = ["b = 1000, gradient (0, -0.6, 0.8)", "b = 250, gradient (1, 0, 0)"]
    assert named_volumes(path) == ["baseline", "baseline", *gradients, "", ""]
    one = open_volume(f"{path}#3")
    np.testing.assert_array_equal(one.read(one.description.geometry.box), VALUES[::-1])


def test_a_diffusion_nrrd_is_an_mr(tmp_path: Path) -> None:
    assert kind_of(nrrd(tmp_path / "dwi.nrrd", VALUES, "modality:=DWMRI"))[0] is Kind.MR
    assert kind_of(nrrd(tmp_path / "plain.nrrd", VALUES, "")) == (Kind.UNKNOWN, "")


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("volsplat.kind:=soup", "soup"),
        ("volsplat.bands:=[1]", "object"),
        ("Segment0_LabelValue:=one", "Segment0_LabelValue should be a number, not “one”"),
        ("Segment0_ID:=a\nSegment0_Layer:=1.0", "Segment0_Layer should be a whole number, not “1.0”"),
        ("Segment0_ID:=a\nSegment0_Color:=1 0 x", "Segment0_Color should be three numbers, not “1 0 x”"),
    ],
)
def test_damaged_keys_of_a_nrrd_are_refused(tmp_path: Path, keys: str, told: str) -> None:
    with pytest.raises(BadInput, match="keys for kind and classes cannot be used") as refused:
        described(nrrd(tmp_path / "damaged.nrrd", VALUES, keys))
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("name", "kind", "band"),
    [
        ("protein", Kind.ELEMENTS, Band("N", 96, 127)),
        ("structure-factors", Kind.STRUCTURE_FACTORS, Band("phase 45 to 90 degrees", 32, 63)),
        ("head", Kind.CT, None),
        ("slab", Kind.UNKNOWN, None),
    ],
)
def test_the_phantoms_in_nrrd_state_what_they_are(tmp_path: Path, name: str, kind: Kind, band: Band | None) -> None:
    path = tmp_path / "phantom.nrrd"
    made = CliRunner().invoke(phantom, [name, "-o", str(path), "--size", "8"])
    assert made.exit_code == 0, made.output
    one = described(path)
    assert one.kind is kind and (band in one.bands if band else one.bands == ())


# Molecules


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("2FO-1FC", Kind.CRYSTAL_MAP),
        ("1abc-2mFo-DFc.map", Kind.CRYSTAL_MAP),
        ("3ek3-2fofc.map.gz", Kind.CRYSTAL_MAP),
        ("2FOFCWT,PH2FOFCWT", Kind.CRYSTAL_MAP),
        ("1FO-1FC", Kind.DIFFERENCE_MAP),
        ("mFo-DFc", Kind.DIFFERENCE_MAP),
        ("1abc_fofc.ccp4", Kind.DIFFERENCE_MAP),
        ("1cbs_diff.ccp4", Kind.DIFFERENCE_MAP),
        ("DELFWT,PHDELWT", Kind.DIFFERENCE_MAP),
        ("pdbx_DELFWT,pdbx_DELPHWT", Kind.DIFFERENCE_MAP),
        ("FOFCWT,PHFOFCWT", Kind.DIFFERENCE_MAP),
        ("diffraction.map", Kind.UNKNOWN),
        ("1cbs.ccp4", Kind.UNKNOWN),
        ("FWT,PHWT", Kind.UNKNOWN),
    ],
)
def test_maps_are_told_apart_by_how_crystallographers_name_them(name: str, kind: Kind) -> None:
    assert kind_of_names([name]) == (kind, name if kind is not Kind.UNKNOWN else "")


def ccp4(path: Path, space_group: int, label: str = "", statistics: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> Path:
    """A map with these words in its header: least, greatest, mean, deviation."""
    raw = bytearray(map_header((7, 6, 5), space_group=space_group, limits=(statistics[0], statistics[1])))
    struct.pack_into("<f", raw, 4 * 21, statistics[2])
    struct.pack_into("<f", raw, 4 * 54, statistics[3])
    struct.pack_into("<i80s", raw, 4 * 55, 1, label.encode())
    return map_file(path, SIGNED, bytes(raw))


@pytest.mark.parametrize(
    ("name", "space_group", "label", "statistics", "kind"),
    [
        ("x.map", 1, "::::EMDATABANK.org::::EMD-3197::::", (-4.1, 5.6, 0.8, 2.4), Kind.EM_MAP),
        ("x.map", 401, "", (0.0, 0.0, 0.0, 0.0), Kind.EM_MAP),
        ("x.map", 20, "2FO-1FC", (-5.0, 5.0, 0.0, 1.0), Kind.CRYSTAL_MAP),
        ("x.map", 1, "1FO-1FC", (-3.0, 9.0, 0.0, 1.0), Kind.DIFFERENCE_MAP),
        ("x_fofc.map", 20, "from fft", (-3.0, 9.0, 0.0, 1.0), Kind.DIFFERENCE_MAP),
        ("x.map", 20, "", (-3.0, 9.0, 0.0, 1.0), Kind.CRYSTAL_MAP),
        ("x.map", 20, "", (-4.9, 5.2, 0.0, 1.0), Kind.DIFFERENCE_MAP),
        ("x.map", 20, "", (0.0, 0.0, 0.0, 0.0), Kind.CRYSTAL_MAP),
    ],
)
def test_ccp4_maps_state_what_they_are_of(
    tmp_path: Path, name: str, space_group: int, label: str, statistics: tuple[float, ...], kind: Kind
) -> None:
    assert kind_of(ccp4(tmp_path / name, space_group, label, statistics))[0] is kind


def test_impossible_statistics_state_nothing() -> None:
    assert not is_difference(float("nan"), 1.0, 0.0, 1.0)
    assert not is_difference(-1.0, 1.0, 0.0, float("nan"))
    assert not is_difference(0.0, 1.0, 0.0, 1.0)
    assert is_difference(-1.0, 1.0, 0.0, 0.3)


@pytest.mark.parametrize(
    ("columns", "part", "kind"),
    [
        ("FWT:F PHWT:P", "", Kind.CRYSTAL_MAP),
        ("DELFWT:F PHDELWT:P", "", Kind.DIFFERENCE_MAP),
        ("FWT:F PHWT:P", "#patterson", Kind.PATTERSON),
        ("FWT:F PHWT:P", "#frequency", Kind.STRUCTURE_FACTORS),
        ("FP:F", "#amplitude", Kind.STRUCTURE_FACTORS),
    ],
)
def test_what_is_made_of_reflections_is_known(tmp_path: Path, columns: str, part: str, kind: Kind) -> None:
    path = mtz(tmp_path / "made.mtz", columns=columns)
    labels = ",".join(column.partition(":")[0] for column in columns.split())
    told = kind_of(f"{path}{part}")
    assert told[0] is kind and told[1] in (f"it is made of {labels}", f"it is made of {labels.split(',')[0]}")


def cube(path: Path, comment: str, orbital: bool = False) -> Path:
    lines = ["title", comment, f"{-1 if orbital else 1} 0 0 0", "2 1 0 0", "2 0 1 0", "2 0 0 1", "6 6 0 0 0"]
    lines += ["1 7"] if orbital else []
    path.write_text("\n".join([*lines, "1 2 3 4 5 6 7 8"]) + "\n")
    return path


@pytest.mark.parametrize(
    ("comment", "orbital", "kind"),
    [
        ("anything", True, Kind.WAVE_FUNCTION),
        ("MO=HOMO", False, Kind.WAVE_FUNCTION),
        ("Electron density from Total SCF Density", False, Kind.ELECTRON_DENSITY),
        ("Spin density", False, Kind.UNKNOWN),
        ("Electrostatic potential from Total SCF Density", False, Kind.UNKNOWN),
        ("Molecule", False, Kind.UNKNOWN),
    ],
)
def test_cube_files_state_what_they_hold(tmp_path: Path, comment: str, orbital: bool, kind: Kind) -> None:
    assert kind_of(cube(tmp_path / "made.cube", comment, orbital))[0] is kind


PDB = """ATOM      1  N   ALA A   1      11.104   6.134  -6.504  1.00  0.00           N
ATOM      2  CA  ALA A   1      11.639   6.071  -5.147  1.00  0.00           C
END
"""


def test_atoms_are_bands_of_elements_or_a_density(tmp_path: Path) -> None:
    path = tmp_path / "two.pdb"
    path.write_text(PDB)
    density = described(f"{path}#density")
    assert density.kind is Kind.ATOM_DENSITY and density.bands == ()
    elements = described(path)
    assert elements.kind is Kind.ELEMENTS and described(f"{path}#elements") == elements
    nitrogen = next(band for band in elements.bands if band.name == "N")
    voxels = open_volume(str(path)).read(elements.geometry.box)
    assert ((voxels >= nitrogen.low) & (voxels <= nitrogen.high)).any()
    assert {band.name for band in elements.bands if ((voxels >= band.low) & (voxels <= band.high)).any()} >= {"N", "C"}
    assert not any(band.low <= 0 <= band.high for band in elements.bands)


# All the rest: what nothing states is unknown.


def test_what_states_nothing_is_unknown(tmp_path: Path) -> None:
    np.save(tmp_path / "array.npy", VALUES)
    raw = tmp_path / "voxels.raw"
    raw.write_bytes(VALUES.tobytes())
    for name in (tmp_path / "array.npy", f"{raw}#dims=7x6x5,type=uint8", written(tmp_path / "x.mha", VALUES)):
        assert kind_of(name) == (Kind.UNKNOWN, "")


REAL = [
    ("dicom_ct_phantom", Kind.CT),
    ("dicom_multiframe/emri_small.dcm", Kind.MR),
    ("nifti/big.nii.gz", Kind.STATISTIC_MAP),
    ("nifti/avg152T1_LR_nifti.nii.gz", Kind.UNKNOWN),
    ("metaimage/HeadMRVolume.mhd", Kind.UNKNOWN),
    ("nrrd/template_T2.nrrd", Kind.UNKNOWN),
    ("maps/3ek3-2fofc.map.gz", Kind.CRYSTAL_MAP),
    ("maps/EMD-3001.map", Kind.CRYSTAL_MAP),
    ("maps/EMD-3197.map", Kind.EM_MAP),
    ("maps/3ek3.cif", Kind.ELEMENTS),
    ("maps/3ek3.cif#density", Kind.ATOM_DENSITY),
    ("structure_factors/r5wkdsf.ent", Kind.CRYSTAL_MAP),
    ("structure_factors/r5wkdsf.ent#map:pdbx_DELFWT,pdbx_DELPHWT", Kind.DIFFERENCE_MAP),
    ("structure_factors/r5wkdsf.ent#frequency", Kind.STRUCTURE_FACTORS),
    ("orbital/benzene-homo.cube", Kind.WAVE_FUNCTION),
    ("orbital/hydrogen_3d_64x64x64.vti", Kind.UNKNOWN),
    ("galaxy/ngc6946.fits", Kind.SPECTRAL_CUBE),
    ("galaxy/l1448_13co.fits", Kind.SPECTRAL_CUBE),
    ("seismic/f3.sgy", Kind.SEISMIC),
]


@pytest.mark.parametrize(("name", "kind"), REAL)
def test_real_volumes_state_their_kind(shared_data: Path, name: str, kind: Kind) -> None:
    stated, by = kind_of(shared_data / name)
    assert stated is kind and bool(by) == (kind is not Kind.UNKNOWN)


# Colours


@pytest.mark.parametrize("fields", ["kinds: RGB-color domain domain", "kinds: domain domain vector", ""])
def test_a_colour_picture_in_nrrd_is_no_thin_volume(tmp_path: Path, fields: str) -> None:
    last = "vector" in fields
    picture = np.zeros((3, 40, 50) if last else (50, 40, 3), np.uint8)
    with pytest.raises(BadInput, match="a 2-D image of 3 values a pixel, volsplat needs a volume"):
        described(nrrd(tmp_path / "picture.nrrd", picture, fields))


def test_a_colour_picture_in_an_array_is_no_thin_volume(tmp_path: Path) -> None:
    path = tmp_path / "picture.npy"
    np.save(path, np.zeros((50, 40, 3), np.uint8))
    with pytest.raises(BadInput, match="a 2-D image of 3 values a pixel, .* name them, as in .*picture.npy#axes=zyx"):
        described(path)
    assert described(f"{path}#axes=zyx").geometry.dims == (3, 40, 50)
    np.save(path, np.zeros((3, 50, 40), np.uint8))
    assert described(path).geometry.dims == (40, 50, 3)


def test_a_thin_volume_in_nrrd_is_one_where_its_header_says_so(tmp_path: Path) -> None:
    thin = np.zeros((50, 40, 3), np.uint8)
    assert described(nrrd(tmp_path / "kinds.nrrd", thin, "kinds: domain domain domain")).geometry.dims == (3, 40, 50)
    assert described(nrrd(tmp_path / "tiny.nrrd", thin[:4, :4], "")).geometry.dims == (3, 4, 4)
    slices = np.zeros((3, 40, 50), np.uint8)
    assert described(nrrd(tmp_path / "slices.nrrd", slices, "kinds: domain domain list")).geometry.dims == (50, 40, 3)

"""`volsplat phantom`: writes a volume that volsplat makes itself."""

from pathlib import Path

import click

from volsplat.client.phantoms import PHANTOMS, make_phantom
from volsplat.client.render_options import triple_from_option
from volsplat.client.volume_writer import check_volume_writable, write_volume


@click.command()
@click.argument("name", type=click.Choice(sorted(PHANTOMS)))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help=".nrrd, .nhdr, .mha, .mhd, .nii…")
@click.option("--size", metavar="I,J,K", help="Voxels along each axis.")
@click.option("--spacing", metavar="I,J,K", help="Millimetres between voxels.")
@click.option("--seed", type=int, default=0, help="Of the noise (0).")
def phantom(name: str, output: Path, size: str | None, spacing: str | None, seed: int) -> None:
    """Make the volume NAME and write it to a file."""
    check_volume_writable(output)
    values, geometry = make_phantom(
        name,
        size=triple_from_option("--size", size, int) if size else None,
        spacing=triple_from_option("--spacing", spacing, float) if spacing else None,
        seed=seed,
    )
    write_volume(output, values, geometry)
    ni, nj, nk = geometry.dims
    click.echo(f"{output}: {name}, {ni} x {nj} x {nk} voxels", err=True)

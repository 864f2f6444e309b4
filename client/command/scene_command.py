"""`volsplat scene`: a complete, commented scene to start from."""

import click

from volsplat.client.scene.presets import PRESETS, preset_scene
from volsplat.client.scene.scene_file import scene_toml


@click.command()
@click.option("--preset", "name", type=click.Choice(sorted(PRESETS)), help="Which scene to start from.")
def scene(name: str | None) -> None:
    """Print a complete, commented scene TOML to start from.

    Without --preset, list the presets. Use the file with `volsplat render VOLUME --scene FILE`.
    """
    if name is None:
        widest = max(map(len, PRESETS))
        for known, preset in PRESETS.items():
            click.echo(f"{known:<{widest}}  {preset.description}")
        return
    click.echo(scene_toml(preset_scene(name), f"{name}: {PRESETS[name].description}"), nl=False)

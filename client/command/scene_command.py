"""`volsplat scene`: a complete, commented scene to start from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from volsplat.client.command.help_page import helped
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.side_console import SideConsole
from volsplat.client.image.image_formats import SCENE_HOLDERS
from volsplat.client.scene.presets import PRESETS
from volsplat.client.scene.scene_file import scene_toml
from volsplat.client.session.session import Session
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.volume_name import check_is_there, volume_name
from volsplat.protocol.text.errors import BadInput


@helped("volsplat scene head.nrrd > head.toml", "volsplat scene --preset ct-skin --zoom 3 > skin.toml")
@click.argument("source", required=False, metavar="[VOLUME|IMAGE]")
@scene_options
def scene(source: str | None, **settings: Any) -> None:
    """Print a complete, commented scene TOML to start from.

    Of a VOLUME the scene that `volsplat render` would draw with the same options, of an IMAGE that volsplat wrote the
    one that it shows; of --preset alone the preset, made for a CT. With none of these, list the presets. Use the file
    with `volsplat render VOLUME --scene FILE`.
    """
    options = SceneOptions.of(settings)
    shows_volume = source is not None and not _shows_a_scene(source)
    if options.fit == "all" and not shows_volume:
        raise BadInput("--fit all is decided by a volume: name one, or give --fit to the command that draws")
    if source is None and options.preset is None:
        widest = max(map(len, PRESETS))
        for known, preset in PRESETS.items():
            click.echo(f"{known:<{widest}}  {preset.description}")
        return
    if source is None:
        assert options.preset is not None
        title = f"{options.preset}: {PRESETS[options.preset].description}"
        click.echo(scene_toml(options.scene_of(None), title), nl=False)
        return
    volume = None
    if shows_volume:
        volume = _surveyed(source)
        options.tell_unsuited(volume, SideConsole())
    elif options.scene is None:
        options = replace(options, scene=Path(source))
    else:
        raise BadInput(f"{source} has a scene of its own; leave out it or --scene")
    click.echo(scene_toml(options.scene_of(volume), f"Of {source}"), nl=False)


def _shows_a_scene(source: str) -> bool:
    """Whether it is an image with its scene; a TIFF without one is a volume. Raises BadInput for other images."""
    path = Path(source)
    if path.suffix.lower() not in SCENE_HOLDERS:
        return False
    from volsplat.client.image.image_file import read_scene  # takes time to import, which only this case needs

    try:
        read_scene(path)
    except BadInput:
        if path.suffix.lower() in (".tif", ".tiff"):
            return False
        raise
    return True


def _surveyed(name: str) -> SurveyedVolume:
    check_is_there(name)
    with SideConsole().status(f"reading {volume_name(name).place}") as status:
        with Session(name, workers=1, held=False, on_progress=status.update) as session:
            return session.volume

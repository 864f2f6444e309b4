"""`volsplat info`: what a volume is, as a map/shade server reports it."""

import json
from pathlib import Path

import click

from volsplat.client.command.help_page import helped, volume_argument
from volsplat.client.session.session import Session
from volsplat.client.volume.volume_facts import volume_facts
from volsplat.client.volume.volume_info import TitledPart, info_text
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.volume_name import check_is_there, volume_name
from volsplat.protocol.text.errors import BadInput


@helped("volsplat info head.nrrd", "volsplat info 'scans/#T2_AX' --json")
@volume_argument
@click.option("--json", "as_json", is_flag=True, help="Print it for programs.")
def info(volume: str, as_json: bool) -> None:
    """Print dimensions, spacing, orientation, type, range and histogram of VOLUME."""
    check_is_there(volume)
    with PlainConsole(stderr=True).status("reading") as status:
        with Session(volume, workers=1, held=False, on_progress=status.update) as session:
            known = session.volume
            parts = _parts(session, volume) if known.prepared is None else []
    if as_json:
        click.echo(json.dumps(volume_facts(known, parts), indent=2))
        return
    PlainConsole().print(info_text(known, parts))


def _parts(session: Session, volume: str) -> list[TitledPart]:
    """What else can be named of the same file; of a folder that holds others by itself nothing is asked."""
    name = volume_name(volume)
    place = Path(name.place).resolve()  # a listing follows no link that leads out of its folder
    if name.is_url or (place.is_dir() and name.part):
        return []
    try:
        told = session.list_folder(place.parent, str(name._replace(place=place.name)))
    except BadInput:  # where a link leads, a file may lack the extension that tells its format
        return []
    parts = [TitledPart(one.part, one.kind) for one in told.entries if one.part]
    return parts if len(parts) > 1 else []

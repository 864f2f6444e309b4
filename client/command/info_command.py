"""`volsplat info`: what a volume is, as a map/shade server reports it."""

import json

import click

from volsplat.client.command.help_page import helped, volume_argument
from volsplat.client.session.session import Session
from volsplat.client.volume.volume_facts import volume_facts
from volsplat.client.volume.volume_info import VolumeInfo
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.volume_name import check_is_there


@helped("volsplat info head.nrrd", "volsplat info 'scans/#T2_AX' --json")
@volume_argument
@click.option("--json", "as_json", is_flag=True, help="Print it for programs.")
def info(volume: str, as_json: bool) -> None:
    """Print dimensions, spacing, orientation, type, range and histogram of VOLUME."""
    check_is_there(volume)
    with PlainConsole(stderr=True).status("reading") as status:
        with Session(volume, workers=1, held=False, on_progress=status.update) as session:
            known = session.volume
    if as_json:
        click.echo(json.dumps(volume_facts(known), indent=2, ensure_ascii=False))
        return
    PlainConsole().print(VolumeInfo.of(known).text())

"""`volsplat demo`: the paper's six images of a head, by two map/shade servers and a splat server."""

from pathlib import Path

import click
import msgspec
from rich.console import Console

from volsplat.client.contact_sheet import write_contact_sheet
from volsplat.client.frame_report import report_of, step_table, write_report
from volsplat.client.image_file import write_image
from volsplat.client.phantoms import make_phantom
from volsplat.client.presets import preset_scene
from volsplat.client.session import Session
from volsplat.client.step_images import step_image_path
from volsplat.client.volume_writer import write_volume

DEMO_WORKERS = 2

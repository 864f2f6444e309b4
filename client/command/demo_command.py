"""`volsplat demo`: the paper's six images of a head, by two map/shade servers and a splat server."""

from pathlib import Path

import click
import msgspec

from volsplat.client.command.help_page import helped
from volsplat.client.command.render_outputs import step_image_path
from volsplat.client.image.contact_sheet import StepPicture, write_contact_sheet
from volsplat.client.image.image_file import write_image
from volsplat.client.image.image_properties import image_properties
from volsplat.client.scene.presets import preset_scene
from volsplat.client.session.frame_report import report_of, step_table, write_report
from volsplat.client.session.renderer import finished_whole
from volsplat.client.session.session import Session
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.command_lines import PATH
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.text.errors import BadInput

DEMO_WORKERS = 2
DEMO_ANGLES = (28.0, 12.0)  # azimuth and elevation
DEMO_ZOOM = 3.2  # the volume's box fills the image
SHEET = "contact-sheet.png"


@helped("volsplat demo --output demo")
@click.option("--output", type=PATH, default=Path("demo"), help="Folder for the images (demo).")
def demo(output: Path) -> None:
    """Make the head phantom and draw its six steps of refinement with two map/shade servers.

    Leaves six images, a contact sheet of them, the volume and a report in one folder, and prints the times.
    """
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{output}: cannot make this folder: {error.strerror}; name another with --output") from error
    from volsplat.client.phantoms import streamed_phantom  # takes torch, for which help is not to wait
    from volsplat.client.phantoms.volume_writer import write_phantom

    console = PlainConsole()
    volume = output / "head.nrrd"
    with console.status("making the head phantom") as status:
        write_phantom(volume, streamed_phantom("head"))
        with Session(volume, workers=DEMO_WORKERS, on_progress=status.update) as session:
            scene = demo_scene(session.volume)
            finished = list(finished_whole(session.refine(scene)))
            outcomes = [refinement.outcome for refinement in finished if refinement.outcome is not None]
            report = report_of(session.volume, scene, outcomes)
            properties = image_properties(session.volume.description, scene)
    for refinement in finished:
        write_image(step_image_path(output, refinement.step), refinement.published.pixels, scene, properties)
    pictures = [
        StepPicture(drawn.step, drawn.published.pixels, outcome.wall_seconds)
        for drawn, outcome in zip(finished, outcomes, strict=True)
    ]
    write_contact_sheet(output / SHEET, pictures, title="volsplat: successive refinement of the head phantom")
    write_report(output / "report.json", report)
    console.print(step_table(report, scene))
    console.say(f"Look at {output / SHEET}; the six images beside it are step-A.png to step-F.png.")


def demo_scene(volume: SurveyedVolume) -> Scene:
    """The skin from a little to the side, with white edges as in the paper's plates."""
    scene = preset_scene("ct-skin", volume.subject())
    return msgspec.structs.replace(
        scene,
        view=View(rotation=rotation_from_angles(*DEMO_ANGLES), zoom=DEMO_ZOOM),
        image=msgspec.structs.replace(scene.image, edges=True),
    )

"""`volsplat render`: one volume, one scene, image files."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

import click
from rich.console import Console

from volsplat.client.frame_report import report_of, write_report
from volsplat.client.interrupts import interrupts_held
from volsplat.client.presets import PRESETS
from volsplat.client.render_options import (
    SceneOptions,
    bounds_from_option,
    size_from_option,
    triple_from_option,
)
from volsplat.client.render_outputs import Outputs, step_image_path
from volsplat.client.renderer import Refinement, Renderer, finished_whole
from volsplat.client.session import ANY_LOOPBACK_PORT, Session
from volsplat.protocol.addresses import Address, parse_address
from volsplat.protocol.errors import BadInput
from volsplat.protocol.scene import Order, Scene, Step
from volsplat.protocol.tokens import TOKEN_VARIABLE, Token, find_token, new_token


@dataclass(frozen=True)
class Servers:
    """Which processes draw, and where they come from."""

    workers: int
    single: bool
    listen: Address | None
    token: Token | None


@click.command()
@click.argument("volume")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Image file: .png, .jpg, .tif or .exr.")
@click.option("--workers", type=click.IntRange(min=1), default=os.cpu_count() or 1, help="Map/shade servers (cores).")
@click.option("--size", metavar="WxH", help="Image size in pixels (512x512).")
@click.option("--scene", type=click.Path(path_type=Path), help="Scene TOML, or an image that volsplat wrote.")
@click.option("--preset", type=click.Choice(sorted(PRESETS)), help="Start from this scene.")
@click.option("--step", type=click.Choice([step.value for step in Step]), default="F", help="Step to draw (F).")
@click.option("--steps-dir", type=click.Path(path_type=Path), help="Write every step up to --step into this folder.")
@click.option(
    "--order", type=click.Choice([order.value for order in Order]), help="Back-to-front or front-to-back (fastest)."
)
@click.option("--rotate", metavar="VIEW", help="x,y,z,w or azimuth,elevation[,roll] or front, back, left, right, top…")
@click.option("--zoom", type=float, metavar="PIXELS", help="Pixels a voxel; else the volume fits the image.")
@click.option("--center", metavar="I,J,K", help="Grid point at the image's centre.")
@click.option("--bounds", metavar="I0:I1,J0:J1,K0:K1", help="Draw only this part of the grid.")
@click.option("--edges/--no-edges", default=None, help="Draw the volume's boundary as white edges.")
@click.option("--single", is_flag=True, help="One process, no servers: the same image.")
@click.option("--report", type=click.Path(path_type=Path), help="Write what each step took, as JSON.")
@click.option("--listen", metavar="HOST:PORT", help="Wait here for servers started by hand, and start none.")
@click.option("--spawn", type=click.Choice(["local", "none"]), help="Start the servers here (local), or none.")
@click.option(
    "--token-file", type=click.Path(path_type=Path), help="The session's token; made with --listen if missing."
)
def render(
    volume: str,
    output: Path | None,
    workers: int,
    size: str | None,
    scene: Path | None,
    preset: str | None,
    step: str,
    steps_dir: Path | None,
    order: str | None,
    rotate: str | None,
    zoom: float | None,
    center: str | None,
    bounds: str | None,
    edges: bool | None,
    single: bool,
    report: Path | None,
    listen: str | None,
    spawn: str | None,
    token_file: Path | None,
) -> None:
    """Draw VOLUME into an image.

    VOLUME is a NRRD, MetaImage, NIfTI or TIFF file or a folder of DICOM slices. Without --scene and --preset the
    scene is chosen from the data.
    """
    scene_options = SceneOptions(
        scene=scene,
        preset=preset,
        size=size_from_option(size) if size else None,
        order=Order(order) if order else None,
        rotate=rotate,
        zoom=zoom,
        center=triple_from_option("--center", center, float) if center else None,
        bounds=bounds_from_option(bounds) if bounds else None,
        edges=edges,
    )
    outputs = Outputs(output, steps_dir, report)
    spawns = spawn == "local" or (spawn is None and listen is None)
    if not spawns and listen is None:
        raise BadInput("--spawn none needs --listen HOST:PORT, where the servers join")
    if single and listen is not None:
        raise BadInput("--single has no servers to listen for; leave out --single or --listen")
    if spawns and not Path(volume).exists():
        raise BadInput(f"{volume}: no such file or folder")
    scene_options.scene_of(None)
    outputs.check(Path(volume))
    servers = Servers(
        workers=workers,
        single=single,
        listen=parse_address(listen) if listen else None,
        token=shared_token(token_file, makes=listen is not None),
    )
    console = Console(stderr=True)
    with opened(volume, servers, spawns, console) as renderer:
        draw(renderer, scene_options, Step(step), outputs, console)


def shared_token(token_file: Path | None, makes: bool) -> Token | None:
    """The token that the environment or the file gives; `makes` the file where there is none. None: no such wish."""
    if makes and token_file is not None and not token_file.exists():
        token = new_token()
        token.write(token_file)
        return token
    return find_token(os.environ, token_file)


@contextmanager
def opened(volume: str, servers: Servers, spawns: bool, console: Console) -> Iterator[Renderer]:
    """The volume, ready to be drawn, with a line on the terminal that says what is going on."""
    with console.status("starting") as status:

        def say(text: str) -> None:
            status.update(text)
            if not console.is_terminal and text.startswith("waiting for servers") and not spawns:
                console.print(text, highlight=False)

        if servers.single:
            from volsplat.client.single import SingleProcess

            with SingleProcess(volume, on_progress=say) as single:
                yield single
            return
        token = servers.token or new_token()
        with Session(
            volume,
            workers=servers.workers,
            listen=servers.listen or ANY_LOOPBACK_PORT,
            spawn=spawns,
            token=token,
            on_progress=say,
        ) as session:
            if not spawns:
                tell_how_to_join(session, token, servers.token is not None, console)
            yield session


def tell_how_to_join(session: Session, token: Token, known: bool, console: Console) -> None:
    """Print the commands that start servers by hand."""
    address = session.address
    secret = "" if known else f"{TOKEN_VARIABLE}={token.key.decode()} "
    everywhere = ip_address(address.host).is_unspecified
    joined = Address(socket.gethostname(), address.port) if everywhere else address
    # Servers on other machines must reach the splat server as well, which by itself listens on its own alone.
    opened = "" if ip_address(address.host).is_loopback else " --listen 0.0.0.0:0"
    for command in (f"splat-server --connect {joined}{opened}", f"mapshade-server --connect {joined}"):
        console.print(f"{secret}volsplat {command}", soft_wrap=True, highlight=False)


def draw(renderer: Renderer, options: SceneOptions, last: Step, outputs: Outputs, console: Console) -> None:
    """Draw the last step, or all up to it where each is wanted, and write the files."""
    scene = options.scene_of(renderer.volume)
    with interrupts_held():  # takes a second to import; by now every server works
        from volsplat.client.image_file import write_image

    finished: list[Refinement] = []
    steps = renderer.refine(scene, last) if outputs.steps_dir is not None else iter([renderer.finish(scene, last)])
    for refinement in finished_whole(steps):
        finished.append(refinement)
        if outputs.steps_dir is not None:
            outputs.make_folder()
            write_image(step_image_path(outputs.steps_dir, refinement.step), refinement.image, scene)
    if outputs.image is not None:
        write_image(outputs.image, finished[-1].image, scene)
        console.print(f"{outputs.image}: {_size(scene)}, {_seconds(finished[-1])} for step {last}", highlight=False)
    if outputs.steps_dir is not None:
        console.print(f"{outputs.steps_dir}: steps A to {last}", highlight=False)
    if outputs.report is not None:
        write_report(outputs.report, report_of(renderer.volume, scene, [r.outcome for r in finished if r.outcome]))


def _size(scene: Scene) -> str:
    return f"{scene.image.width}x{scene.image.height}"


def _seconds(refinement: Refinement) -> str:
    assert refinement.outcome is not None
    return f"{refinement.outcome.wall_seconds:.3f} s"

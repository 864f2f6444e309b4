"""The page: where each panel stands."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.ui.controls.page_frame import page_frame, theme_button
from volsplat.client.ui.controls.scene_upload import SceneUpload
from volsplat.client.ui.opening.dropped_files import DroppedFiles, refuse
from volsplat.client.ui.opening.next_volume import NextVolume
from volsplat.client.ui.opening.open_dialog import OpenDialog
from volsplat.client.ui.opening.opening import Opening
from volsplat.client.ui.opening.opening_progress import OpeningProgress
from volsplat.client.ui.panels.colour_bar import ColourBar
from volsplat.client.ui.panels.drawers import Drawers
from volsplat.client.ui.panels.folding import Folding
from volsplat.client.ui.panels.panel_widths import PanelWidths
from volsplat.client.ui.panels.phase_legend import PhaseLegend
from volsplat.client.ui.panels.save_panel import save_panel
from volsplat.client.ui.panels.scene_panels import scene_panels
from volsplat.client.ui.panels.servers.servers_panel import ServersPanel
from volsplat.client.ui.panels.skip_links import skip_links
from volsplat.client.ui.panels.start_again import StartAgain
from volsplat.client.ui.panels.steps_bar import steps_bar
from volsplat.client.ui.panels.volume_information import volume_information
from volsplat.client.ui.tables.tables_panel import tables_panel
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.ui.viewport.early_picture import early_picture
from volsplat.client.ui.viewport.viewport_element import ViewportElement


def page(viewing: Viewing, restart: Restart | None = None, opening: Opening | None = None) -> None:
    """Build the page for one tab.

    Without a `restart`, a session that has ended stays so; without `opening`, it stays with this volume.
    """
    description = viewing.volume.description
    page_frame(description.name)
    with ui.element("div").classes("vs-page"):  # within NiceGUI's main
        skip_links()
        with ui.element("header").classes("vs-head").props("role=banner"):
            name = ui.label(description.name).classes("vs-name").tooltip(description.name)
            name.props("role=heading aria-level=1")
            ui.label(" × ".join(str(n) for n in description.geometry.dims)).classes("vs-muted")
            volume_information(viewing.volume)
            dialog = OpenDialog(opening) if opening is not None else None
            if opening is not None and opening.may_step:
                NextVolume(opening)
            steps_bar(viewing)
            ui.element("div").classes("vs-spread")
            scenes = SceneUpload(viewing)
            save_panel(viewing, scenes)
            DroppedFiles(scenes, dialog.offer if dialog is not None else refuse)
            theme_button()
            Drawers()
        with ui.element("aside").classes("vs-left").props("aria-label=scene"):
            scene_panels(viewing)
        with ui.element("section").classes("vs-view").props("aria-label=picture"):
            ViewportElement(viewing.default_scene.view.rotation, viewing.number)
            ColourBar(viewing)
            PhaseLegend(viewing)
            if opening is not None:
                OpeningProgress(opening)
            if restart is not None:
                StartAgain(viewing, restart)
        with ui.element("aside").classes("vs-right").props('aria-label="tables of the scene"'):
            tables_panel(viewing)
        with ui.element("footer").classes("vs-foot").props("role=contentinfo"):
            ServersPanel(viewing)
        Folding()
        PanelWidths()
    early_picture(viewing)  # last, since the first picture may be finished meanwhile

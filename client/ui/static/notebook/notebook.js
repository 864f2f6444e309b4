// The viewport in a notebook, with its controls if asked for: loads the page's own modules from their texts, and carries
// what is said by widget messages.

/** The modules as blobs, each import pointing to the blob of what it names. @returns {{imported: (name: string) => Promise<any>, release: () => void}} */
function linked(sources) {
  const addresses = new Map();
  for (const [name, source] of Object.entries(sources)) {
    const text = source.replace(/from\s+["']\.\/([\w./]+)["']/g, (_, imported) => `from "${addresses.get(imported)}"`);
    addresses.set(name, URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  }
  return {
    imported: (name) => import(addresses.get(name)),
    release: () => addresses.forEach((address) => URL.revokeObjectURL(address)), // what was imported stays
  };
}

const RESTARTED = "the kernel was restarted, or has ended; run this cell again";

/** What Viewport talks through. */
class WidgetTransport {
  constructor(model) {
    this.model = model;
    this.view = crypto.getRandomValues(new Uint32Array(4)).join("-"); // randomUUID is for pages by HTTPS alone
    this.heard = true; // as long as the kernel hears us
    this.onword = () => {}; // once the kernel says anything to us
    this.listeners = { message: (_message) => {}, picture: (_header, _bytes) => {}, state: (_state) => {} };
    this.received = (content, buffers) => {
      if (content.view !== this.view) return;
      this.onword();
      if (content.controls) return;
      if (content.text !== null) this.listeners.message(JSON.parse(content.text));
      else this.takePicture(new Uint8Array(buffers[0].buffer, buffers[0].byteOffset, buffers[0].byteLength));
    };
    this.ended = () => this.lost();
    model.on("msg:custom", this.received);
    model.on("comm_live_update", this.ended); // Jupyter's own word
  }

  open() {
    this.tell({ text: null });
    if (this.heard) this.listeners.state({ connected: true, anew: true, text: "" });
  }

  /** To the kernel: once it is another one, which knows nothing of the widget, notebooks throw at that. */
  tell(content) {
    if (!this.heard) return;
    try {
      this.model.send({ view: this.view, ...content });
    } catch {
      this.lost();
    }
  }

  lost() {
    this.heard = false;
    this.listeners.state({ connected: false, text: RESTARTED });
  }

  takePicture(bytes) {
    const length = new DataView(bytes.buffer, bytes.byteOffset, 4).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    this.listeners.picture(header, bytes.subarray(4 + length));
  }

  send(object) { this.tell({ text: JSON.stringify(object) }); }
  onmessage(listener) { this.listeners.message = listener; }
  onpicture(listener) { this.listeners.picture = listener; }
  onstate(listener) { this.listeners.state = listener; }
  close() {
    this.model.off("msg:custom", this.received);
    this.model.off("comm_live_update", this.ended);
    this.tell({ closed: true });
  }
}

/** The controls in an element of their own. @returns {Promise<() => void>} what ends them */
async function beside(cell, imported, model, transport) {
  const host = document.createElement("div");
  host.className = "vs-notebook-controls";
  cell.append(host);
  const { NotebookControls } = await imported("notebook/notebook_controls.js");
  const controls = new NotebookControls(host, (said) => transport.tell({ controls: said }));
  const received = (content) => content.view === transport.view && content.controls && controls.show(content.controls);
  model.on("msg:custom", received);
  return () => { model.off("msg:custom", received); controls.close(); };
}

/** The saved picture in place of all else until the kernel says anything: for good on pages that have none. */
function showStill(cell, still, transport) {
  if (!still) return;
  const image = document.createElement("img");
  image.className = "vs-notebook-still";
  image.alt = "the volume when this cell ran";
  image.src = `data:image/png;base64,${still}`;
  cell.append(image);
  transport.onword = () => image.remove();
}

/** Keys are the element's own while it has the focus: JupyterLab would take M as "make the cell Markdown", which ends us. */
function keepKeys(element) {
  element.dataset.lmSuppressShortcuts = "true";
}

export default {
  async render({ model, el }) {
    const cell = document.createElement("div"); // the style of `el` is the widget's layout's, which clears it
    cell.className = "vs-notebook";
    cell.style.height = `${model.get("height")}px`;
    cell.addEventListener("focusin", (event) => keepKeys(event.target));
    el.append(cell);
    const host = document.createElement("div");
    host.className = "vs-notebook-viewport";
    cell.append(host);
    const { imported, release } = linked(model.get("modules"));
    const { Viewport } = await imported("viewport/viewport.js");
    const transport = new WidgetTransport(model);
    const viewport = new Viewport(host, transport);
    const end = model.get("controls") ? await beside(cell, imported, model, transport) : () => {};
    release();
    showStill(cell, model.get("still"), transport);
    transport.open();
    return () => { end(); viewport.close?.(); transport.close(); };
  },
};

// The viewport in a notebook: loads the page's own modules from their texts, and carries what is said by widget messages.

/** The modules as blobs, each import pointing to the blob of what it names. @returns {Promise<any>} the last one */
async function loaded(sources) {
  const addresses = new Map();
  let last = "";
  for (const [name, source] of Object.entries(sources)) {
    const linked = source.replace(/from\s+["']\.\/([\w./]+)["']/g, (_, imported) => `from "${addresses.get(imported)}"`);
    last = URL.createObjectURL(new Blob([linked], { type: "text/javascript" }));
    addresses.set(name, last);
  }
  return import(last);
}

/** What Viewport talks through. */
class WidgetTransport {
  constructor(model) {
    this.model = model;
    this.view = crypto.randomUUID();
    this.listeners = { message: (_message) => {}, picture: (_header, _bytes) => {}, state: (_state) => {} };
    this.received = (content, buffers) => {
      if (content.view !== this.view) return;
      if (content.text !== null) this.listeners.message(JSON.parse(content.text));
      else this.takePicture(new Uint8Array(buffers[0].buffer, buffers[0].byteOffset, buffers[0].byteLength));
    };
    model.on("msg:custom", this.received);
  }

  open() {
    this.model.send({ view: this.view, text: null });
    this.listeners.state({ connected: true, anew: true, text: "" });
  }

  takePicture(bytes) {
    const length = new DataView(bytes.buffer, bytes.byteOffset, 4).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
    this.listeners.picture(header, bytes.subarray(4 + length));
  }

  send(object) { this.model.send({ view: this.view, text: JSON.stringify(object) }); }
  onmessage(listener) { this.listeners.message = listener; }
  onpicture(listener) { this.listeners.picture = listener; }
  onstate(listener) { this.listeners.state = listener; }
  close() { this.model.off("msg:custom", this.received); }
}

export default {
  async render({ model, el }) {
    const host = document.createElement("div");
    host.style.cssText = `position: relative; width: 100%; height: ${model.get("height")}px;`;
    el.append(host);
    const { Viewport } = await loaded(model.get("modules"));
    const transport = new WidgetTransport(model);
    const viewport = new Viewport(host, transport);
    transport.open();
    return () => { viewport.close?.(); transport.close(); };
  },
};

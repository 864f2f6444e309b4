// The viewport as a component of the page.

import { Slices } from "volsplat/slices/slices.js";
import { Viewport } from "volsplat/viewport/viewport.js";
import { ViewportSocket } from "volsplat/viewport/viewport_socket.js";

/** The picture that came with the page; null if there is none, or it cannot be shown. @param {Element | null} early */
function earlyImage(early) {
  const image = early?.querySelector("img") ?? null;
  return image !== null && image.complete && image.naturalWidth > 0 ? image : null;
}

export default {
  template: '<div class="vs-viewport-host"></div>',
  props: { tab: String, home: Array, volume: Number, prefix: String },
  mounted() {
    const under = (path) => new URL(`${this.prefix}/${path}`, window.location.href);
    const url = under("viewport");
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    url.searchParams.set("tab", this.tab);
    url.searchParams.set("volume", this.volume);
    this.socket = new ViewportSocket(url, under("alive"));
    const makeSlices = (listener) => new Slices(this.$el, listener);
    const early = document.querySelector(".vs-early");
    const options = { home: this.home, wholePage: true, early: earlyImage(early), makeSlices };
    this.viewport = new Viewport(this.$el, this.socket, options);
    early?.remove();
    this.socket.onslice((header, bytes) => void this.viewport.slices.show(header, bytes));
    /** @type {any} */ (window).volsplatViewport = this.viewport; // for tests, and for measuring latency
    this.socket.open();
  },
  unmounted() {
    this.socket.close();
    this.viewport.close();
  },
};

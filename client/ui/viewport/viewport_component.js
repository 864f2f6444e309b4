// The viewport as a component of the page.

import { Slices } from "volsplat/slices/slices.js";
import { Viewport } from "volsplat/viewport/viewport.js";
import { ViewportSocket } from "volsplat/viewport/viewport_socket.js";

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
    this.viewport = new Viewport(this.$el, this.socket, { home: this.home, wholePage: true, makeSlices });
    this.socket.onslice((header, bytes) => void this.viewport.slices.show(header, bytes));
    /** @type {any} */ (window).volsplatViewport = this.viewport; // for tests, and for measuring latency
    this.socket.open();
  },
  unmounted() {
    this.socket.close();
    this.viewport.close();
  },
};

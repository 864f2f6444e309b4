// The Vue wrapper of kept_events.js and drafts.js.
import { keepDraft } from "volsplat/controls/drafts.js";
import { keepEvents, keepPage } from "volsplat/controls/kept_events.js";

export default {
  template: `<span hidden></span>`,
  async mounted() {
    await this.$nextTick(); // the page makes its socket once all that is in it is there
    const page = /** @type {any} */ (window);
    keepEvents(page.socket);
    keepPage(page.socket, () => page.did_handshake);
    keepDraft();
  },
};

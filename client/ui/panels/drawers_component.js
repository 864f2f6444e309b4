// The Vue wrapper of drawers.js.
import { Drawers } from "volsplat/controls/drawers.js";

export default {
  template: `<div class="vs-drawers" role="group" aria-label="panels"></div>`,
  props: { panels: Array },
  mounted() {
    this.drawers = new Drawers(this.$el, this.$el.closest(".vs-page"), this.panels);
  },
  unmounted() {
    this.drawers.close();
  },
};

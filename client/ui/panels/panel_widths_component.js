// The Vue wrapper of panel_widths.js.
import { PanelWidths } from "volsplat/controls/panel_widths.js";

export default {
  template: `<span hidden></span>`,
  props: { edges: Array },
  mounted() {
    this.widths = new PanelWidths(this.$el.closest(".vs-page"), this.edges);
  },
  unmounted() {
    this.widths.close();
  },
};

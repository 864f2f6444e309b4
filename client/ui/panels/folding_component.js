// The Vue wrapper of folding.js.
import { Folding } from "volsplat/controls/folding.js";

export default {
  template: `<span hidden></span>`,
  mounted() {
    this.folding = new Folding(this.$el.closest(".vs-page"));
  },
  unmounted() {
    this.folding.close();
  },
};

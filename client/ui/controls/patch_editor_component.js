// The 2-D table's editor as a component of the page: hands what is told to static/tables/patch_editor.js, and its
// events on.
import { handLed } from "volsplat/controls/hand_led.js";
import { PatchEditor } from "volsplat/tables/patch_editor.js";

export default {
  mixins: [handLed],
  template: `<div class="vs-plane"></div>`,
  props: { axes: Object },
  emits: ["seen"],
  mounted() {
    this.editor = new PatchEditor(this.$el, { onChange: this.move, onSeen: () => this.$emit("seen") });
    this.editor.showAxes(this.axes);
    this.show(this.told.value);
    this.$watch(() => this.axes, (axes) => this.editor.showAxes(axes));
  },
  methods: {
    show(patches) {
      this.editor.show(patches);
    },
    /** The 2-D histogram, behind the patches. */
    showCounts(levels, side) {
      this.editor.showCounts(levels, side);
    },
  },
  unmounted() {
    this.editor.close();
  },
};

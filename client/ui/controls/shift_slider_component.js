// The Vue wrapper of shift_slider.js.
import { ShiftSlider } from "volsplat/tables/shift_slider.js";

export default {
  template: `<div class="vs-shift"></div>`,
  props: { name: String, length: Number, enabled: Boolean },
  mounted() {
    this.slider = new ShiftSlider(this.$el, this.name, (by, settled) => this.$emit("shift", { by, settled }));
    this.$watch(() => [this.length, this.enabled], () => this.slider.showAxis(this.length, this.enabled), { immediate: true });
  },
  unmounted() {
    this.slider.close();
  },
};

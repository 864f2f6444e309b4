// The browser's own swatch, which opens its colour picker.
import { handLed } from "volsplat/controls/hand_led.js";
import { followHand } from "volsplat/controls/held_input.js";

export default {
  mixins: [handLed],
  template: `<input type="color" class="vs-swatch" :aria-label="name" :value="value" />`,
  props: { name: String },
  mounted() {
    this.closing = new AbortController();
    followHand(this.$el, (settled) => this.move(this.$el.value, settled), this.closing.signal);
  },
  unmounted() {
    this.closing.abort();
  },
};

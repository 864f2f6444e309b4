// The browser's own swatch, which opens its colour picker.
import { handLed } from "volsplat/controls/hand_led.js";

export default {
  mixins: [handLed],
  template: `<input type="color" class="vs-swatch" :aria-label="name" :value="value"
    @input="move($event.target.value, false)" @change="move($event.target.value, true)" />`,
  props: { name: String },
};

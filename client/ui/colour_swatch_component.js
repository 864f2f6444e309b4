// The browser's own swatch, which opens its colour picker.
import { handLed } from "/volsplat/static/hand_led.js";

export default {
  mixins: [handLed],
  template: `<input type="color" class="vs-swatch" :aria-label="name" :value="colour"
    @input="pick($event, false)" @change="pick($event, true)" />`,
  props: { name: String },
  data() {
    return { colour: this.told.value };
  },
  methods: {
    show(colour) {
      this.colour = colour;
    },
    pick(event, settled) {
      this.colour = event.target.value;
      this.move(this.colour, settled);
    },
  },
};

// Quasar's slider or range.
import { handLed } from "/volsplat/static/hand_led.js";

export default {
  mixins: [handLed],
  template: `
    <component :is="tag" dense :min="min" :max="max" :step="step" :disable="disable" :aria-label="name"
      :model-value="position" @update:model-value="slide($event, false)" @change="slide($event, true)"
    ><slot></slot></component>`,
  props: { tag: String, name: String, min: Number, max: Number, step: Number, disable: Boolean },
  data() {
    return { position: this.told.value };
  },
  methods: {
    show(position) {
      this.position = position;
    },
    slide(position, settled) {
      this.position = position;
      this.move(position, settled);
    },
  },
};

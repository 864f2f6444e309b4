// Quasar's slider or range.
import { handLed } from "volsplat/controls/hand_led.js";

export default {
  mixins: [handLed],
  template: `
    <component :is="tag" dense :min="min" :max="max" :step="step" :disable="disable" :aria-label="name"
      :model-value="value" @update:model-value="move($event, false)" @change="move($event, true)"
    ><slot></slot></component>`,
  props: { tag: String, name: String, min: Number, max: Number, step: Number, disable: Boolean },
};

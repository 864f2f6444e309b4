// Quasar's field for text.
import { handLed } from "volsplat/controls/hand_led.js";

export default {
  mixins: [handLed],
  template: `
    <q-input dense outlined hide-bottom-space no-error-icon autocomplete="off" :aria-label="name"
      :error="complaint !== ''" :error-message="complaint" :model-value="value" @update:model-value="move($event, false)" />`,
  props: { name: String, complaint: String },
};

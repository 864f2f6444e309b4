// Quasar's field for text.
import { handLed } from "/volsplat/static/hand_led.js";

export default {
  mixins: [handLed],
  template: `
    <q-input dense outlined hide-bottom-space no-error-icon autocomplete="off" :aria-label="name"
      :error="complaint !== ''" :error-message="complaint" :model-value="text" @update:model-value="type" />`,
  props: { name: String, complaint: String },
  data() {
    return { text: this.told.value };
  },
  methods: {
    show(text) {
      this.text = text;
    },
    type(text) {
      this.text = text;
      this.move(text, false);
    },
  },
};

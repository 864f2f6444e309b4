// The Vue wrapper of step_chips.js.
import { StepChips } from "volsplat/controls/step_chips.js";

export default {
  template: `<div class="vs-steps" role="group" aria-label="steps"></div>`,
  props: { steps: Array },
  mounted() {
    this.chips = new StepChips(this.$el, this.steps);
  },
  methods: {
    show(states) {
      this.chips.show(states);
    },
  },
};

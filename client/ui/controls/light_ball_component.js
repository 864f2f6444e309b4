// The Vue wrapper of light_ball.js.
import { handLed } from "volsplat/controls/hand_led.js";
import { LightBall } from "volsplat/controls/light_ball.js";

export default {
  mixins: [handLed],
  template: `<canvas class="vs-light-ball" tabindex="0" role="application" aria-label="direction of the light"></canvas>`,
  mounted() {
    this.ball = new LightBall(this.$el, this.move);
    this.show(this.told.value);
  },
  methods: {
    show(direction) {
      this.ball.show(direction);
    },
  },
  unmounted() {
    this.ball.close();
  },
};

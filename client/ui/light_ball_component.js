// The Vue wrapper of light_ball.js.
import { LightBall } from "/volsplat/static/light_ball.js";

export default {
  template: `<canvas class="vs-light-ball" tabindex="0" role="application" aria-label="direction of the light"></canvas>`,
  props: { direction: Array },
  mounted() {
    this.ball = new LightBall(this.$el, (direction, settled) => this.$emit("turned", { direction, settled }));
    this.ball.show(this.direction);
  },
  watch: {
    direction(direction) {
      this.ball.show(direction);
    },
  },
  unmounted() {
    this.ball.close();
  },
};

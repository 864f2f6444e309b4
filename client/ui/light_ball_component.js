// The Vue wrapper of light_ball.js. What the server tells in answer to an earlier move of the hand is passed over.
import { LightBall } from "/volsplat/static/light_ball.js";

export default {
  template: `<canvas class="vs-light-ball" tabindex="0" role="application" aria-label="direction of the light"></canvas>`,
  props: { told: Object },
  mounted() {
    this.moves = 0;
    this.ball = new LightBall(this.$el, (direction, settled) => {
      this.moves += 1;
      this.$emit("turned", { direction, settled, moves: this.moves });
    });
    this.ball.show(this.told.direction);
  },
  watch: {
    told(told) {
      if (told.moves >= this.moves) this.ball.show(told.direction);
    },
  },
  unmounted() {
    this.ball.close();
  },
};

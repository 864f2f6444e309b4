// What the components of hand_led.py's elements have in common: the hand leads. Its moves are numbered, and what the
// server tells in answer to an earlier one is passed over. A component shows `told.value` at first, and has show(value).

/** A mixin for Vue. */
export const handLed = {
  props: { told: Object },
  emits: ["moved"],
  created() {
    this.moves = this.told.moves;
  },
  methods: {
    move(value, settled) {
      this.moves += 1;
      this.$emit("moved", { value, settled, moves: this.moves });
    },
  },
  watch: {
    told(told) {
      if (told.moves >= this.moves) this.show(told.value);
    },
  },
};

// What the components of hand_led.py's elements have in common: the hand leads. Its moves are numbered, and what the
// server tells in answer to an earlier one is passed over.

/** A mixin for Vue. Templates show `value`, and call `move` with what the hand makes of it. */
export const handLed = {
  props: { told: Object },
  emits: ["moved"],
  data() {
    return { value: this.told.value };
  },
  created() {
    this.moves = this.told.moves;
  },
  methods: {
    show(value) {
      this.value = value;
    },
    move(value, settled) {
      this.value = value;
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

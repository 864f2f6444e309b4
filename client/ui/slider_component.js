// Quasar's slider or range. The hand leads: what the server tells in answer to an earlier move of it is passed over.
export default {
  template: `
    <component :is="tag" dense :min="min" :max="max" :step="step" :disable="disable" :aria-label="name"
      :model-value="position" @update:model-value="slide($event, false)" @change="slide($event, true)"
    ><slot></slot></component>`,
  props: { tag: String, name: String, min: Number, max: Number, step: Number, disable: Boolean, told: Object },
  data() {
    return { position: this.told.position, moves: 0 };
  },
  methods: {
    slide(position, settled) {
      this.position = position;
      this.moves += 1;
      this.$emit("slide", { position, settled, moves: this.moves });
    },
  },
  watch: {
    told(told) {
      if (told.moves >= this.moves) this.position = told.position;
    },
  },
};

// Quasar's slider or range. It has role and values on the element around those that take the focus, where no screen reader
// looks, and logarithms on a logarithmic scale. Here each thumb has them, with the number that the page shows beside it.
import { handLed } from "volsplat/controls/hand_led.js";

const DIGITS = 3; // of a number on a logarithmic scale, as slider.py makes it
const ENDS = { Home: 0, End: 1 };
const MISPLACED = ["role", "aria-valuemin", "aria-valuemax", "aria-valuenow", "aria-orientation", "aria-disabled"];

export default {
  mixins: [handLed],
  template: `
    <component :is="isRange ? 'q-range' : 'q-slider'" dense :min="min" :max="max" :step="step" :disable="disable" v-bind="around"
      :model-value="value" @update:model-value="slide($event, false)" @change="slide($event, true)" @keydown="goToEnd"
    ><slot></slot></component>`,
  props: { names: Array, unit: String, logarithmic: Boolean, min: Number, max: Number, step: Number, disable: Boolean },
  data() {
    const { position, texts } = this.told.value;
    return { value: position, texts, around: Object.fromEntries(MISPLACED.map((name) => [name, null])) };
  },
  computed: {
    isRange() {
      return this.names.length > 1;
    },
    /** What each thumb says. */
    said() {
      return this.reaches().map((reach, n) => {
        const [least, most] = reach.map((end) => this.numberAt(end));
        return {
          role: "slider",
          "aria-label": this.names[n],
          "aria-valuemin": least,
          "aria-valuemax": most,
          "aria-valuenow": Math.min(most, Math.max(least, Number(this.texts[n]))),
          "aria-valuetext": withUnit(this.texts[n], this.unit),
          "aria-disabled": this.disable,
        };
      });
    },
  },
  mounted() {
    this.$watch("said", () => this.say(), { immediate: true, flush: "post" });
  },
  methods: {
    show({ position, texts }) {
      this.value = position;
      this.texts = texts;
    },
    slide(position, settled) {
      this.texts = (this.isRange ? [position.min, position.max] : [position]).map((part) => `${this.numberAt(part)}`);
      this.move(position, settled);
    },
    /** Home and End, which Quasar does not know. */
    goToEnd(event) {
      const thumb = this.thumbs().indexOf(event.target);
      if (thumb < 0 || this.disable || !(event.key in ENDS)) return;
      event.preventDefault();
      const end = this.reaches()[thumb][ENDS[event.key]];
      this.slide(this.isRange ? { ...this.value, [thumb === 0 ? "min" : "max"]: end } : end, true);
    },
    say() {
      this.thumbs().forEach((thumb, n) => {
        for (const [name, value] of Object.entries(this.said[n])) thumb.setAttribute(name, `${value}`);
      });
    },
    /** Where each thumb can go: of a range neither goes past the other. */
    reaches() {
      return this.isRange ? [[this.min, this.value.max], [this.value.min, this.max]] : [[this.min, this.max]];
    },
    /** What takes the focus. */
    thumbs() {
      return [...this.$el.querySelectorAll("[tabindex]")];
    },
    numberAt(position) {
      return this.logarithmic ? Number((10 ** position).toPrecision(DIGITS)) : position;
    },
  },
};

/** @param {string} number @param {string} unit of more than one */
function withUnit(number, unit) {
  return unit ? `${number} ${number === "1" ? unit.replace(/s$/, "") : unit}` : number;
}

// The table editor as a component of the page: hands its properties to static/table_editor.js, and its events on.
import { TableEditor } from "volsplat/tables/table_editor.js";

export default {
  template: `
    <section class="vs-table" :aria-label="name">
      <header class="vs-table-head"><div ref="head" class="vs-table-title"></div><slot></slot></header>
      <div ref="body" class="vs-table-body"></div>
    </section>`,
  props: { name: String, colour: Boolean, shown: Object, axis: Object, histogram: Array, unused: String, tint: String },
  emits: ["change", "select", "load"],
  mounted() {
    this.editor = new TableEditor(this.$refs.head, this.$refs.body, {
      name: this.name,
      colour: this.colour,
      onChange: (change) => this.$emit("change", change),
      onSelect: (index) => this.$emit("select", index),
      onLoad: (file) => this.$emit("load", file),
    });
    this.showField();
    this.show(this.shown);
    this.$watch(() => this.shown, (shown) => this.show(shown));
    this.$watch(() => [this.axis, this.histogram, this.unused, this.tint], () => this.showField());
  },
  unmounted() {
    this.editor.close();
  },
  methods: {
    show({ points, answers }) {
      this.editor.showPoints(points, answers);
    },
    showField() {
      this.editor.showField(this.axis, this.histogram ?? null, this.unused, this.tint);
    },
    /** Tell of bad input at the table. */
    complain(text) {
      this.editor.complain(text);
    },
    /** Have the person choose a table's file; its text comes as a `load` event. */
    pickFile() {
      this.editor.pickFile();
    },
  },
};

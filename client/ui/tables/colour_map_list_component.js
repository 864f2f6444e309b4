// Colour maps by name: a field that finds them, for which tables, and what is found, each with its colours.
// The focus stays in the field; the arrow keys go through the list, as in any combo box.
export default {
  template: `
    <div class="vs-maps">
      <input type="text" role="combobox" class="vs-maps-words" data-autofocus tabindex="0" aria-autocomplete="list" aria-expanded="true"
        aria-label="colour map: part of its name" placeholder="part of a name" autocomplete="off" spellcheck="false"
        :aria-controls="id + '-list'" :aria-activedescendant="found.length ? id + '-' + active : null"
        v-model="words" @keydown="key" />
      <div role="radiogroup" aria-label="tables that take the colours" class="vs-maps-tables">
        <label v-for="(name, table) in tables" :key="table">
          <input type="radio" :name="id + '-table'" :value="table" v-model="which" />{{ name }}
        </label>
      </div>
      <ul role="listbox" aria-label="colour maps" class="vs-maps-list" :id="id + '-list'" ref="list">
        <li v-for="(map, n) in found" :key="map.name" role="option" :id="id + '-' + n" :aria-selected="n === active"
          @pointermove="active = n" @click="take(n)">
          <span class="vs-preset-strip" :style="stripe(map)"></span>{{ map.name }}
        </li>
      </ul>
      <p role="status" class="vs-muted">{{ told }}</p>
      <p v-for="line in notes" class="vs-muted">{{ line }}</p>
    </div>`,
  props: { maps: Array, tables: Object, first: String, notes: Array },
  emits: ["taken"],
  data() {
    return { words: "", which: this.first, active: 0, id: `vs-maps-${this.$.uid}` };
  },
  computed: {
    found() {
      const wanted = this.words.toLowerCase().split(/\s+/);
      return this.maps.filter((map) => wanted.every((word) => map.name.toLowerCase().includes(word)));
    },
    told() {
      if (!this.maps.length) return this.notes.length ? "" : "looking for colour maps …";
      return this.words.trim() ? `${this.found.length} of ${this.maps.length} colour maps` : `${this.maps.length} colour maps`;
    },
  },
  watch: {
    words() {
      this.active = 0;
      this.$refs.list.scrollTop = 0;
    },
  },
  methods: {
    stripe(map) {
      return { backgroundImage: `linear-gradient(90deg, ${map.colours.join(", ")})` };
    },
    take(n) {
      if (n < this.found.length) this.$emit("taken", { name: this.found[n].name, which: this.which });
    },
    key(event) {
      const last = this.found.length - 1;
      const moves = { ArrowDown: this.active + 1, ArrowUp: this.active - 1, PageDown: this.active + 10, PageUp: this.active - 10 };
      if (event.key === "Enter") this.take(this.active);
      else if (event.key in moves) this.go(Math.max(0, Math.min(last, moves[event.key])));
      else return;
      event.preventDefault();
    },
    async go(n) {
      this.active = n;
      await this.$nextTick();
      this.$refs.list.children[n]?.scrollIntoView({ block: "nearest" });
    },
  },
};

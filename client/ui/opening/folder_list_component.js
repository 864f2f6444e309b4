// What lies in a folder, a button for each: its name, its kind and its size.
export default {
  template: `
    <ul class="vs-entries" :aria-label="label">
      <li v-for="(entry, n) in entries" :key="n">
        <button type="button" class="vs-entry" :disabled="busy" @click="$emit('chosen', n)">
          <i class="q-icon material-icons" aria-hidden="true">{{ entry.icon }}</i>
          <span class="vs-entry-name" :title="entry.name">{{ entry.name }}</span>
          <span class="vs-entry-kind">{{ entry.kind }}</span>
          <span class="vs-entry-size">{{ entry.size }}</span>
        </button>
      </li>
    </ul>`,
  props: { label: String, entries: Array, busy: Boolean },
  emits: ["chosen"],
  watch: {
    /** Another folder begins at its top, also for who goes about by keys. */
    async entries() {
      const held = this.$el.contains(document.activeElement);
      await this.$nextTick();
      this.$el.scrollTop = 0;
      if (held) this.$el.querySelector("button")?.focus();
    },
  },
};

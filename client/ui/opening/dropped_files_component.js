// The Vue wrapper of dropping.js, and what is seen while files are held over the page.
import { Dropping } from "volsplat/opening/dropping.js";

export default {
  template: `
    <div class="vs-dropping" aria-hidden="true">
      <p>Drop a <b>scene</b>, or an image saved here, to see it.</p>
      <p>Drop a <b>volume</b> to look for it among the files that the servers see.</p>
    </div>`,
  props: { scenes: Array, upload: Number },
  emits: ["dropped"],
  mounted() {
    this.dropping = new Dropping(this.$el, (file, isFolder, count) => {
      if (count === 1 && !isFolder && this.upload !== null && this.isScene(file.name)) {
        window["runMethod"](this.upload, "addFiles", [[file]]); // NiceGUI's
      } else {
        this.$emit("dropped", file.name, isFolder ? 0 : file.size, isFolder, count);
      }
    });
  },
  unmounted() {
    this.dropping.close();
  },
  methods: {
    /** @param {string} name */
    isScene(name) {
      return this.scenes.some((suffix) => name.toLowerCase().endsWith(suffix));
    },
  },
};

// A line of words that change often. They are told by a call: for a property NiceGUI would go over the whole page.
export default {
  template: `<div></div>`,
  methods: {
    show(text) {
      this.$el.textContent = text;
    },
  },
};

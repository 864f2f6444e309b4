// @ts-check
// The steps and tables beside the viewport in a notebook: shows what it is told of them, and says what a person does.
import { StepChips } from "../controls/step_chips.js";
import { TableEditor } from "../tables/table_editor.js";

/** @typedef {import("../controls/step_chips.js").ChipState} ChipState */
/** @typedef {import("../tables/table_editor.js").Change} Change */
/** @typedef {import("../tables/table_editor.js").Point} Point */
/** @typedef {import("../tables/table_editor.js").Axis} Axis */
/** @typedef {{name: string, colour: boolean, points: Point[], answers: number, axis: Axis, histogram: number[] | null,
 *   unused: string, tint: string}} Table */
/** `without_g`: why there is no picture of step G; "" if there is.
 * @typedef {{steps?: string[], without_g?: string, chips?: ChipState[], finest?: string,
 *   tables?: Record<string, Table>, complaint?: {which: string, text: string}}} Told */
/** @typedef {{type: "finest", finest: string} | ({type: "table", which: string} & Change)} Said */

export class NotebookControls {
  /** @type {StepChips} */
  #chips;
  #crisp = document.createElement("button");
  #withoutG = "";
  #beforeG = "F"; // what the scene asked for
  /** @type {Record<string, TableEditor>} */
  #editors = {};

  /** @param {HTMLElement} host @param {(said: Said) => void} say */
  constructor(host, say) {
    this.host = host;
    this.say = say;
    this.#crisp.type = "button";
    this.#crisp.textContent = "refine to G";
    this.#crisp.addEventListener("click", () => {
      const on = this.#crisp.getAttribute("aria-pressed") === "true";
      say({ type: "finest", finest: on ? this.#beforeG : "G" });
    });
  }

  /** @param {Told} told */
  show({ steps, without_g: withoutG, chips, finest, tables, complaint }) {
    if (steps) this.#addSteps(steps);
    if (withoutG !== undefined) this.#crisp.title = this.#withoutG = withoutG;
    if (chips) this.#chips.show(chips);
    if (finest) this.#showFinest(finest);
    for (const [which, table] of Object.entries(tables ?? {})) this.#showTable(which, table);
    if (complaint) this.#editors[complaint.which].complain(complaint.text);
  }

  close() {
    for (const editor of Object.values(this.#editors)) editor.close();
  }

  /** A scene that asks for G where there is none can be led back. @param {string} finest */
  #showFinest(finest) {
    if (finest !== "G") this.#beforeG = finest;
    this.#crisp.setAttribute("aria-pressed", String(finest === "G"));
    this.#crisp.disabled = this.#withoutG !== "" && finest !== "G";
  }

  /** @param {string[]} steps the letters */
  #addSteps(steps) {
    const row = added(this.host, "vs-notebook-steps");
    const group = added(row, "vs-steps");
    group.setAttribute("role", "group");
    group.setAttribute("aria-label", "steps");
    this.#chips = new StepChips(group, steps);
    row.append(this.#crisp);
  }

  /** @param {string} which @param {Table} table */
  #showTable(which, table) {
    const editor = (this.#editors[which] ??= this.#addTable(which, table));
    editor.showField(table.axis, table.histogram, table.unused, table.tint);
    editor.showPoints(table.points, table.answers);
  }

  /** @param {string} which @param {Table} table */
  #addTable(which, { name, colour }) {
    const section = document.createElement("section");
    section.className = "vs-table";
    section.setAttribute("aria-label", name);
    this.host.append(section);
    const head = added(added(section, "vs-table-head"), "vs-table-title");
    return new TableEditor(head, added(section, "vs-table-body"), {
      name,
      colour,
      onChange: (change) => this.say({ type: "table", which, ...change }),
      onSelect: () => {},
      onLoad: () => {},
    });
  }
}

/** @param {HTMLElement} parent @param {string} name the class of a new part of it */
function added(parent, name) {
  const element = document.createElement("div");
  element.className = name;
  parent.append(element);
  return element;
}

// @ts-check
// What is typed into a panel's field and not entered yet outlives that the page is loaded anew, as it is after a long cut.

const KEPT = "volsplat-draft"; // of the tab
const FIELD = ".vs-field input";

/** @param {EventTarget | null} target @returns {HTMLInputElement | null} */
function fieldOf(target) {
  return target instanceof HTMLInputElement && target.matches(FIELD) ? target : null;
}

/** @param {HTMLElement} field */
function isSeen(field) {
  return field.getClientRects().length > 0 && getComputedStyle(field).visibility === "visible";
}

function bringBack() {
  const { name, typed } = JSON.parse(sessionStorage.getItem(KEPT) ?? "{}");
  const fields = [.../** @type {NodeListOf<HTMLInputElement>} */ (document.querySelectorAll(FIELD))];
  const field = fields.find((one) => one.ariaLabel === name && isSeen(one));
  if (name === undefined || field === undefined || field.value === typed) return;
  field.focus();
  field.value = typed;
  field.dispatchEvent(new Event("input", { bubbles: true }));
}

/** Begin with what was kept when the page was left. */
export function keepDraft() {
  bringBack();
  document.addEventListener("input", ({ target }) => {
    const field = fieldOf(target);
    if (field) sessionStorage.setItem(KEPT, JSON.stringify({ name: field.ariaLabel, typed: field.value }));
  });
  const entered = (/** @type {Event} */ { target }) => fieldOf(target) && sessionStorage.removeItem(KEPT);
  document.addEventListener("focusout", entered);
  document.addEventListener("keydown", (event) => event.key === "Enter" && entered(event));
}

// Making SVG elements.

/** @param {string} name @param {Record<string, string>} attributes @param {Element[]} children @returns {SVGElement} */
export function svg(name, attributes = {}, children = []) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** @param {SVGElement} line @param {number[]} from @param {number[]} to */
export function drawLine(line, from, to) {
  line.setAttribute("x1", from[0].toFixed(1));
  line.setAttribute("y1", from[1].toFixed(1));
  line.setAttribute("x2", to[0].toFixed(1));
  line.setAttribute("y2", to[1].toFixed(1));
}

// Where the focus goes when the button that had it leaves the page. Otherwise keyboard users would start at the top
// again, and screen readers would say nothing.

/** Focuses the first of these ids that is on the page after the next render. Headings need `tabindex="-1"`. */
export const focusSoon = (...ids) =>
  setTimeout(() => ids.map(id => document.getElementById(id)).find(Boolean)?.focus());

// Where the focus goes when the button that had it leaves the page: else whoever uses keys starts at the top again, and whoever
// hears the page hears nothing.

/** Focuses the first of these ids that is on the page once it is drawn anew. Headings need `tabindex="-1"`. */
export const focusSoon = (...ids) =>
  setTimeout(() => ids.map(id => document.getElementById(id)).find(Boolean)?.focus());

// What the service says in sentences: what stands in backticks is to be typed or read as it is.
import { html } from './preact.js';

export const Prose = ({ text, lang }) => html`
  <span lang=${lang}>${text.split('`').map((piece, at) => (at % 2 ? html`<code key=${at}>${piece}</code>` : piece))}</span>`;

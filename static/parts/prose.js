// A sentence of the service; text in backticks is shown as code.
import { html } from './preact.js';

export const Prose = ({ text, lang }) => html`
  <span lang=${lang}>${text.split('`').map((piece, at) => (at % 2 ? html`<code key=${at}>${piece}</code>` : piece))}</span>`;

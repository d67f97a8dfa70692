// Sentences of the service; text in backticks is shown as code.
import { html } from '../../preact.js';
import { problemDetail } from '../../translate.js';

export const Prose = ({ text, lang }) => html`
  <span lang=${lang}>${text.split('`').map((piece, at) => (at % 2 ? html`<code key=${at}>${piece}</code>` : piece))}</span>`;

/** What to do about a problem. A page's own problem may have markup as its detail, or none. */
export function ProblemDetail({ problem }) {
  const { text, lang } = problemDetail(problem);
  return typeof text === 'string' ? html`<${Prose} text=${text} lang=${lang} />` : text;
}

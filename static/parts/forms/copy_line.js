// A secret that is shown once, with a button that copies it.
import { html, useState } from '../../preact.js';
import { t } from '../../texts.js';

const words = t.setup.agent;

export const CopyLine = ({ name, text }) => html`
  <div class="stack tight">
    <span class="label">${name}</span>
    <div class="secret">${text}</div>
    <${CopyButton} name=${name} text=${text} />
  </div>`;

/** Copies a text; browsers allow it only on secure pages. @param {{ name: string, text: string, label?: string }} props */
export function CopyButton({ name, text, label = words.copy }) {
  const [isCopied, setCopied] = useState(false);
  const copy = () => navigator.clipboard?.writeText(text).then(() => setCopied(true), () => {});
  return isSecureContext && html`<div class="row"><button class="button" type="button" aria-label=${words.copyNamed(name)}
    onClick=${copy}>${label}</button><span role="status" class="small">${isCopied ? words.copied : ''}</span></div>`;
}

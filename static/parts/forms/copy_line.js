// A secret that is shown once, with a button that copies it.
import { html, useState } from '../../preact.js';
import { t } from '../../texts.js';

const words = t.setup.agent;

export function CopyLine({ name, text }) {
  const [isCopied, setCopied] = useState(false);
  const copy = () => navigator.clipboard?.writeText(text).then(() => setCopied(true), () => {});
  return html`
    <div class="stack tight">
      <span class="label">${name}</span>
      <div class="secret">${text}</div>
      ${isSecureContext && html`<div class="row"><button class="button" type="button" aria-label=${words.copyNamed(name)}
        onClick=${copy}>${words.copy}</button><span role="status" class="small">${isCopied ? words.copied : ''}</span></div>`}
    </div>`;
}

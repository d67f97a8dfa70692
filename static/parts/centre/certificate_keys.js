// The public keys of the centre's certificates, and making a new key.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { date } from '../../format.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { Loading, ProblemNotice } from '../page/notice.js';

const words = t.certificates;

export function CertificateKeys() {
  const [isAsking, setAsking] = useState(false);
  const { data: keys, problem, reload } = useData(signal => api.certificates.keys(signal), []);
  return html`
    <section class="card certificate-keys"><header><h2>${words.keys}</h2></header><div class="body stack">
      <p class="small muted">${words.keysBody}</p>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!keys && !problem && html`<${Loading} />`}
      ${keys?.length === 0 && html`<p>${words.keyNone}</p>`}
      <ul>${keys?.map(key => html`<li key=${key.id}><a href=${api.certificates.keyAddress(key.id)} download>${key.id}</a>
        <span class="small muted"> ${[words.keySince(date(key.created_at)), key.retired_at && words.keyUntil(date(key.retired_at))].filter(Boolean).join(', ')}</span></li>`)}</ul>
      ${keys && keys.length > 0 && html`<p><button class="button" type="button" onClick=${() => setAsking(true)}>${words.keyReplace}</button></p>`}
      ${isAsking && html`<${Confirm} title=${words.keyReplace} body=${words.keyReplaceBody} yes=${words.keyReplace}
        onYes=${() => api.certificates.replaceKey().then(reload)} onClose=${() => setAsking(false)} />`}
    </div></section>`;
}

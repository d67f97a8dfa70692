// All certificates that the caller may see, with a filter by state. For staff.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { usePages } from '../data.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { CertificateList } from '../parts/people/certificates.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.certificates;
const STATES = /** @type {const} */ (['valid', 'under_review', 'withdrawn']);

/** @param {Props} props */
export default function Certificates({ person, route }) {
  const state = STATES.find(one => one === route.query.get('state'));
  const [round, setRound] = useState(0); // Counts up when a certificate was changed: the list starts again.
  const list = usePages((cursor, signal) => api.certificates.page({ state, cursor }, signal), [state, round]);
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      <a class="button" href=${href(['trainees'])}>${t.nav.trainees}</a>
    <//>
    <section class="card">
      <div class="filters"><${Field} type="select" label=${words.state} value=${state ?? ''}
        options=${[['', words.all], ...STATES.map(one => [one, words.states[one]])]}
        onInput=${event => replace(['certificates'], { state: event.target.value || undefined })} /></div>
      <div class="body stack">
        <${ProblemNotice} problem=${list.problem} onRetry=${list.more} />
        ${!list.items && !list.problem && html`<${Loading} />`}
        ${list.items?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
        ${list.items && html`<${CertificateList} certificates=${list.items} person=${person} withNames onChange=${() => setRound(round + 1)} />`}
        ${list.next && html`<p><button class="button" type="button" onClick=${list.more}>${words.more}</button></p>`}
      </div>
    </section>`;
}

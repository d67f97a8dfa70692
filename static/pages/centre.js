// The centre's name and logo, as the sign-in page, the head of each page and printed sheets show them.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { showCentre, useCentre } from '../centre.js';
import { asProblem } from '../data.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { logoPicture } from '../parts/centre/logo_picture.js';
import { CertificateKeys } from '../parts/centre/certificate_keys.js';
import { Form } from '../parts/forms/form.js';
import { Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { CentreLetterhead, CentreMark } from '../parts/page/centre_mark.js';

const words = t.centre;

export default function CentrePage() {
  const centre = useCentre();
  const [saved, setSaved] = useState(null);
  const done = what => changed => {
    showCentre(changed);
    setSaved(what);
  };
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['service'])}>${t.nav.service}</a><//>
    <div class="stack">
      ${saved && html`<${Notice} key=${saved} tone="good" title=${saved} />`}
      <div class="columns">
        <${NameCard} key=${centre.name} centre=${centre} onSaved=${done(words.nameSaved)} />
        <${LogoCard} centre=${centre} onSaved=${done(words.logoSaved)} onRemoved=${() => done(words.logoRemoved)({ ...centre, logo_version: null })} />
      </div>
      <${Example} />
      <${CertificateKeys} />
    </div>`;
}

const NameCard = ({ centre, onSaved }) => html`
  <section class="card"><header><h2>${words.name}</h2></header><div class="body">
    <${Form} fields=${[{ name: 'name', label: words.name, hint: words.nameHint, value: centre.name, maxlength: 120, clears: true, autocomplete: 'organization' }]}
      onSave=${({ name }) => api.centre.setName(name).then(onSaved)} />
  </div></section>`;

function LogoCard({ centre, onSaved, onRemoved }) {
  const [problem, setProblem] = useState(null);
  const send = async ({ logo: [file] }, form) => {
    setProblem(null);
    onSaved(await api.centre.setLogo(await logoPicture(file)));
    form.reset();
  };
  const remove = () => api.centre.removeLogo().then(onRemoved, error => setProblem(asProblem(error)));
  return html`
    <section class="card"><header><h2>${words.logo}</h2>${centre.logo_version && html`<button class="button bare" type="button"
      onClick=${remove}>${words.removeLogo}</button>`}</header><div class="body stack">
      <${ProblemNotice} problem=${problem} />
      <${Form} fields=${[{ name: 'logo', label: words.file, hint: words.fileHint, type: 'file', accept: 'image/png,image/jpeg', required: true }]}
        onSave=${send} submit=${words.send} busyWords=${words.sending} />
    </div></section>`;
}

/** What the pages and the sheets show now. */
const Example = () => html`
  <section class="card"><header><h2>${words.shown}</h2></header><div class="body stack">
    <p class="small muted">${words.onPages}</p>
    <div class="centre-example"><div class="brand"><${CentreMark} /></div></div>
    <p class="small muted">${words.onSheets}</p>
    <div class="centre-example"><article class="report"><header><${CentreLetterhead} /><p class="title">${t.certificate.title}</p></header></article></div>
  </div></section>`;

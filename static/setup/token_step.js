// Step 6: the token of the box's own program, shown once, and what to type on the computer beside the box.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { basePath } from '../base_path.js';
import { dateTime } from '../format.js';
import { may } from '../roles.js';
import { t } from '../texts.js';
import { CopyLine } from '../parts/forms/copy_line.js';
import { focusSoon } from '../parts/forms/focus.js';
import { Form } from '../parts/forms/form.js';
import { Notice } from '../parts/page/notice.js';
import { QrCode } from './qr.js';

const words = t.setup.agent;

/** @param {Props} props */
export function TokenStep({ box, person, onChange }) {
  const [made, setMade] = useState(null);
  const create = async ({ name }) => {
    const { token } = await api.tokens.create({ name, role: 'agent', box: box.id });
    setMade(token);
    focusSoon('token-made');
    onChange();
  };
  if (!may(person, 'people')) return html`<${Notice} quiet title=${words.notYou}>${words.notYouBody}<//>`;
  return html`
    <p>${words.either}</p>
    ${box.tokens.length > 0 && html`<p class="small muted">${words.existing}</p>
      <ul class="bullets small">${box.tokens.map(({ id, name, created_at, last_used_at, expires_at }) => html`<li key=${id}>
        ${words.token(name, dateTime(created_at), last_used_at && dateTime(last_used_at), expires_at && dateTime(expires_at))}</li>`)}</ul>`}
    ${!made && html`<${Form} fields=${[{ name: 'name', label: words.name, required: true, maxlength: 100, value: words.nameOf(box.name) }]}
      onSave=${create} submit=${words.make} />`}
    ${made && html`<${Made} box=${box} token=${made} />`}`;
}

/** @param {Props} props */
function Made({ box, token }) {
  const file = `${box.code}.token`;
  const keep = `(umask 077; echo ${token} > ${file})`;
  const from = `--server ${location.origin}${basePath} --box ${box.code} --token-file ${file}`;
  const size = box.calibration ? ` --option video_size=${box.calibration.width}x${box.calibration.height}` : '';
  const install = `sudo trocar agent install ${from} --screen 8090${size} /dev/video0`;
  const record = `trocar agent ${from} --trainee ${words.trainee} --task ${words.task} /dev/video0`;
  return html`
    <h3 id="token-made" tabindex="-1">${words.made}</h3>
    <${Notice} tone="warn" title=${words.once}>${words.onceBody}<//>
    <div class="token">
      <div class="stack">
        <${CopyLine} name=${words.secret} text=${token} />
        <${CopyLine} name=${words.keep} text=${keep} />
        <${CopyLine} name=${words.install} text=${install} />
        <p class="small muted">${words.installBody}</p>
        <details class="how"><summary>${words.run}</summary>
          <${CopyLine} name=${words.run} text=${record} />
          <p class="small muted">${words.runBody}</p></details>
      </div>
      <figure class="stack tight">
        <${QrCode} text=${`${keep}\n${install}\n`} name=${words.code} />
        <figcaption class="small muted">${words.codeBody}</figcaption>
      </figure>
    </div>`;
}

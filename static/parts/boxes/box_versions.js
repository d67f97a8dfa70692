// The versions of a box's camera or colours: since when each is valid, and a dialog that changes it.
import { html, useState } from '../../preact.js';
import { Problem } from '../../api.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';

const words = t.box.versions;

/** @typedef {{ id: string, version: number, created_at: string, valid_from: string, in_use: boolean }} BoxVersion */

/** The version in use comes first, the others follow from the newest to the oldest. @template {BoxVersion} V @param {V[]} versions */
export const inUseFirst = versions => [...versions].sort((one, other) => Number(other.in_use) - Number(one.in_use));

/** True if staff stated since when it is valid. @param {Pick<BoxVersion, 'created_at' | 'valid_from'>} version */
const isDated = version => version.valid_from !== version.created_at;

/**
 * `change(id, body)` sends the new time of a version; `more(version)` gives further words on it.
 *
 * @param {{ title: string, versions: BoxVersion[], mayEdit: boolean | undefined, change: (box: string, id: string, body: { valid_from: string | null }) => Promise<unknown>,
 *   box: Props['box'], onChange: () => unknown, more?: (version: any) => string | null }} props
 */
export function BoxVersions({ title, box, versions, mayEdit, change, onChange, more = () => null }) {
  const [open, setOpen] = useState(/** @type {BoxVersion | null} */ (null));
  if (!versions.length) return null;
  const newest = [...versions].sort((one, other) => other.version - one.version);
  return html`
    <details class="versions">
      <summary>${title} (${versions.length})</summary>
      <p class="small muted">${words.rule}</p>
      <ul class="edit-list">${newest.map(one => html`
        <li key=${one.id}>
          <div>
            <strong>${words.version(one.version)}${one.in_use && html` <span class="pill good">${words.inUse}</span>`}</strong>
            <p class="small">${[words.made(dateTime(one.created_at)), isDated(one) && words.validFrom(dateTime(one.valid_from)), more(one)]
              .filter(Boolean).join(' · ')}</p>
          </div>
          ${mayEdit && html`<button class="button" type="button" aria-label=${`${words.change}: ${words.version(one.version)}`}
            onClick=${() => setOpen(one)}>${words.change}</button>`}
        </li>`)}</ul>
    </details>
    ${open && html`<${ValidFromDialog} version=${open} change=${body => change(box.id, open.id, body)} onClose=${() => setOpen(null)}
      onDone=${() => (setOpen(null), onChange())} />`}`;
}

/** A time as the browser's field takes it, in the device's time zone. */
const localTime = iso => {
  const at = new Date(iso);
  return new Date(at.getTime() - at.getTimezoneOffset() * 60_000).toISOString().slice(0, 16);
};

function ValidFromDialog({ version, change, onClose, onDone }) {
  const fields = [
    {
      name: 'from',
      label: words.from,
      hint: words.fromHint(dateTime(version.created_at)),
      type: 'datetime-local',
      value: isDated(version) ? localTime(version.valid_from) : '',
      max: localTime(Date.now()),
      wide: true,
    },
  ];
  const save = async ({ from }) => {
    if (from && Number.isNaN(Date.parse(from))) throw new Problem({ title: words.noTime, status: 0 });
    await change({ valid_from: from ? new Date(from).toISOString() : null });
    onDone();
  };
  return html`
    <${Dialog} title=${words.title(version.version)} onClose=${onClose}>
      <p>${words.body}</p>
      <${Form} fields=${fields} onSave=${save} onCancel=${onClose} />
    <//>`;
}

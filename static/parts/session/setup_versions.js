// The versions of the box's camera and colours that a session was tracked with, and whether they are those of its day.
import { html } from '../../preact.js';
import { date } from '../../format.js';
import { may } from '../../roles.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';

const words = t.session.setup;
const PARTS = /** @type {const} */ (['calibration', 'palette']);

/** @param {Schemas['UsedVersionResponse']} used */
export const usedVersionText = used =>
  [words.version(used.version, date(used.created_at)), used.valid_from !== used.created_at && words.validFrom(date(used.valid_from))]
    .filter(Boolean)
    .join(', ');

/** What a reader of the numbers must know: the recording is older than the box's set-up, or other versions are valid now. @param {Props} props */
export function SetupWarnings({ session, person }) {
  const { setup } = session;
  if (!setup) return null;
  const later = PARTS.filter(part => setup[part].is_later);
  const replaced = PARTS.filter(part => setup[part].valid_version !== null);
  const toBox = may(person, 'see_boxes') && html` <a href=${href(['boxes', session.box.id])}>${t.session.toBox(session.box.name)}</a>`;
  return html`
    ${later.length > 0 && html`<${Notice} tone="warn" title=${words.older}>${later.map(part => html`
      <p key=${part}>${words.olderThan[part](date(session.recorded_at), date(setup[part].valid_from))}</p>`)}
      <p>${words.olderBody}${toBox}</p><//>`}
    ${replaced.length > 0 && html`<${Notice} tone="warn" title=${words.replaced}>${replaced.map(part => html`
      <p key=${part}>${words.replacedBy[part](setup[part].version, setup[part].valid_version)}</p>`)}
      ${may(person, 'retry') && session.retry_can_help && html`<p>${words.replacedBody}</p>`}<//>`}`;
}

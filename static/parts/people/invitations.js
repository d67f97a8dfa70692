// Invitations that were just made: a list with the links, and slips to print. The links are on this page only.
import { html } from '../../preact.js';
import { csvTime } from '../../csv.js';
import { date, dateTime } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { QrCode } from '../../setup/qr.js';
import { CopyButton } from '../forms/copy_line.js';
import { CentreLetterhead } from '../page/centre_mark.js';
import { Notice } from '../page/notice.js';
import { SaveTable } from '../page/save_table.js';

const words = t.invitations;

/** Where the service is, as the reader of a slip types it. */
const serviceAddress = () => `${location.origin}${href([])}`;
const linkOf = ({ secret }) => `${location.origin}${href(['choose-password'])}#${secret}`;

/** Hosts that mean the computer itself: a link with one of them works on no other. */
const OWN_HOSTS = /^(localhost|127\.|\[::1\])/;

/** @param {{ invitations: Schemas['MadeInvitation'][] }} props */
export const MadeInvitations = ({ invitations }) => html`
  <div class="stack">
    <section class="card">
      <header><div><h2>${words.made(invitations.length)}</h2><p class="small muted">${words.onlyHere}</p></div>
        <button class="button main" type="button" onClick=${() => window.print()}>${words.print}</button></header>
      ${OWN_HOSTS.test(location.hostname) && html`<div class="body"><${Notice} tone="warn" quiet title=${words.ownHost}>${words.ownHostBody}<//></div>`}
      <div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.name}</th><th scope="col">${words.login}</th><th scope="col">${words.until}</th><td></td></tr></thead>
        <tbody>${invitations.map(one => html`<tr key=${one.login}><th scope="row">${one.trainee ? html`<a href=${href(['trainees', one.trainee])}>${one.name}</a>` : one.name}</th><td class="code">${one.login}</td>
          <td class="when">${dateTime(one.expires_at)}</td><td><${CopyButton} name=${words.linkOf(one.name)} text=${linkOf(one)} label=${words.copy} /></td></tr>`)}</tbody>
      </table></div>
      <${SaveTable} name=${words.fileName} rows=${() => tableRows(invitations)} isPrinted=${false} />
    </section>
    <${Slips} invitations=${invitations} />
  </div>`;

/** The links for a program that writes letters or mails. */
const tableRows = invitations => [
  [words.name, words.login, words.link, words.until],
  ...invitations.map(one => [one.name, one.login, linkOf(one), csvTime(one.expires_at)]),
];

/** One slip for each person, to cut apart: as on paper. */
const Slips = ({ invitations }) => html`
  <section class="slips" aria-label=${words.slips}>${invitations.map(one => html`
    <article class="slip report" key=${one.login}>
      <header><${CentreLetterhead} /><p class="title">${words.slipTitle}</p></header>
      <div>
        <div>
          <p class="who">${one.name}</p>
          <dl class="facts">
            <dt>${words.address}</dt><dd>${serviceAddress()}</dd>
            <dt>${words.login}</dt><dd class="login">${one.login}</dd>
            <dt>${words.linkValid}</dt><dd>${date(one.expires_at)}</dd>
          </dl>
          <p>${words.how}</p>
        </div>
        <${QrCode} text=${linkOf(one)} name=${words.qrOf(one.name)} />
      </div>
      <p class="link">${linkOf(one)}</p>
    </article>`)}</section>`;

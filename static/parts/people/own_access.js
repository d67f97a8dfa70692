// Where the own account is signed in, and the programs that act as it.
import { html, useState } from '../../preact.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { Empty } from '../page/notice.js';

const words = t.account;
/** A browser states a long name; these parts of it show which one it is. */
const BROWSERS = [['Edg/', 'Edge'], ['OPR/', 'Opera'], ['Firefox/', 'Firefox'], ['Chrome/', 'Chrome'], ['Safari/', 'Safari']];
const SYSTEMS = [['Android', 'Android'], ['iPad', 'iPad'], ['iPhone', 'iPhone'], ['Windows', 'Windows'], ['Mac OS', 'macOS'], ['Linux', 'Linux']];

/** The name of a browser for people. */
function browserName(text) {
  const found = list => list.find(([part]) => text.includes(part))?.[1];
  return [found(BROWSERS), found(SYSTEMS)].filter(Boolean).join(' · ') || text.slice(0, 40) || words.unknownBrowser;
}

/** @param {Props} props */
export function OwnSignIns({ items, onEnd }) {
  return html`
    <section class="card">
      <header><h2>${words.signIns}</h2></header>
      <ul class="queue">
        ${items.map(item => html`
          <li key=${item.id}>
            <div><strong>${browserName(item.browser)}</strong>
              <span class="small muted">${item.address} · ${words.signedInAt(dateTime(item.signed_in_at))} ·
                ${' '}${words.lastSeen(dateTime(item.last_seen_at))}</span></div>
            ${item.is_current ? html`<span class="pill good">${words.thisBrowser}</span>`
              : html`<button class="button bare" type="button" aria-label=${`${words.end}: ${browserName(item.browser)}`}
                onClick=${() => onEnd(item.id)}>${words.end}</button>`}
          </li>`)}
      </ul>
    </section>`;
}

/** @param {Props} props */
export function OwnTokens({ items, onRemove }) {
  const [removing, setRemoving] = useState(null);
  return html`
    <section class="card">
      <header><h2>${words.tokens}</h2></header>
      ${items.length === 0 ? html`<${Empty} title=${words.noTokens} body=${words.noTokensBody} />` : html`
        <p class="small muted">${words.tokensHint}</p>
        <ul class="queue">${items.map(token => html`
          <li key=${token.id}>
            <div><strong>${token.name}</strong><span class="small muted">${t.roles[token.role] ?? token.role} ·
              ${' '}<${TokenDates} token=${token} /></span></div>
            <button class="button bare" type="button" aria-label=${`${t.people.remove}: ${token.name}`}
              onClick=${() => setRemoving(token)}>${t.people.remove}</button>
          </li>`)}</ul>`}
      ${removing && html`<${Confirm} title=${t.people.removeTitle(removing.name)} body=${words.removeToken} yes=${t.people.remove}
        onYes=${() => onRemove(removing.id)} onClose=${() => setRemoving(null)} />`}
    </section>`;
}

/** When a token was last used, when it ends, and whether another token made it. */
export const TokenDates = ({ token }) => html`
  ${token.last_used_at ? words.lastUsed(dateTime(token.last_used_at)) : words.neverUsed} ·
  ${' '}${token.expires_at ? words.expires(dateTime(token.expires_at)) : words.neverExpires}${token.made_with && ` · ${words.madeWithToken}`}`;

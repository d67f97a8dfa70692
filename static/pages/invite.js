// How the trainees sign in, and invitations for many of them at once: accounts, and links for choosing the passwords.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { dateTime } from '../format.js';
import { href, replace } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { Empty, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { MadeInvitations } from '../parts/people/invitations.js';

const words = t.invitations;

/** @param {Props} props */
export default function Invite({ route }) {
  const group = route.query.get('group') ?? '';
  const { data, current, problem, reload } = useData(async signal => {
    const [groups, accounts] = await Promise.all([api.groups.all(), api.invitations.accounts(group || undefined, signal)]);
    return { groups, accounts };
  }, [group]);
  const [made, setMade] = useState(null);
  if (made) return html`<${Made} made=${made} onAgain=${() => (setMade(null), reload())} />`;
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['trainees'])}>${t.nav.trainees}</a>
      <a class="button" href=${href(['enrol'])}>${t.groups.enrol}</a><//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data && html`<section class="card">
      <div class="filters"><${Field} type="select" label=${words.group} value=${group} options=${[['', words.allGroups], ...data.groups.map(one => [one.id, one.name])]}
        onInput=${event => replace(['invite'], { group: event.target.value })} /></div>
      ${!current ? html`<${Loading} />` : current.accounts.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody}><a class="button main"
        href=${href(['enrol'])}>${t.groups.enrol}</a><//>` : html`<${Choice} key=${group} accounts=${current.accounts} onMade=${setMade} />`}
    </section>`}`;
}

/** @param {Schemas['TraineeAccountResponse']} account */
const hasPassword = ({ password }) => Boolean(password && password !== 'missing');
/** Proposed are trainees who cannot sign in, and have no link that is still valid. */
const isProposed = one => !hasPassword(one) && !one.link_expires_at;

/** @param {{ accounts: Schemas['TraineeAccountResponse'][], onMade: (made: Schemas['MadeInvitations']) => void }} props */
function Choice({ accounts, onMade }) {
  const [chosen, setChosen] = useState(() => new Set(accounts.filter(isProposed).map(one => one.trainee)));
  const [logins, setLogins] = useState(/** @type {Record<string, string>} */ ({}));
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(false);
  const choose = (trainee, isChosen) => setChosen(before => new Set([...before].filter(one => one !== trainee).concat(isChosen ? trainee : [])));
  const replaced = accounts.filter(one => chosen.has(one.trainee) && hasPassword(one));
  const send = async event => {
    event.preventDefault();
    setBusy(true);
    setProblem(null);
    const toInvite = accounts.filter(one => chosen.has(one.trainee));
    const invitations = toInvite.map(one => ({ trainee: one.trainee, login: (!one.login && logins[one.trainee]) || undefined }));
    await api.invitations.create(invitations, replaced.length > 0).then(onMade, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  const all = isChosen => setChosen(new Set(isChosen ? accounts.filter(one => !hasPassword(one)).map(one => one.trainee) : []));
  return html`
    <form class="invite" onSubmit=${send}>
      <div class="body row">
        <button class="button" type="button" onClick=${() => all(true)}>${words.chooseAll}</button>
        <button class="button" type="button" onClick=${() => all(false)}>${words.chooseNone}</button>
      </div>
      <div class="scroll"><table class="table">
        <thead><tr><th scope="col"><span class="unseen">${words.choose}</span></th><th scope="col">${words.name}</th><th scope="col">${words.login}</th><th scope="col">${words.state}</th></tr></thead>
        <tbody>${accounts.map(one => html`
          <tr key=${one.trainee}>
            <td><label class="check"><input type="checkbox" aria-label=${words.chooseOne(one.name)} checked=${chosen.has(one.trainee)}
              onChange=${event => choose(one.trainee, event.target.checked)} /></label></td>
            <th scope="row"><a href=${href(['trainees', one.trainee])}>${one.name}</a></th>
            <td class="code">${one.login ?? html`<input class="login" type="text" aria-label=${words.loginOf(one.name)} placeholder=${one.code} maxlength="64"
              autocapitalize="none" autocomplete="off" spellcheck=${false} value=${logins[one.trainee] ?? ''} onInput=${event => setLogins({ ...logins, [one.trainee]: event.target.value.trim() })} />`}</td>
            <td><${State} account=${one} /></td>
          </tr>`)}</tbody>
      </table></div>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} />
        ${replaced.length > 0 && html`<${Notice} tone="warn" title=${words.replaces(replaced.length)}>${words.replacesBody}<//>`}
        <div class="actions row"><button class="button main" type="submit" disabled=${busy || chosen.size === 0}>${busy ? words.making : words.make(chosen.size)}</button></div>
      </div>
    </form>`;
}

const TONES = { signs_in: 'good', open: '', none: 'warn', expired: 'warn' };

/** @param {{ account: Schemas['TraineeAccountResponse'] }} props */
function State({ account }) {
  const { person, link_expires_at: until } = account;
  const state = hasPassword(account) ? 'signs_in' : until ? 'open' : person ? 'expired' : 'none';
  return html`<span class=${`pill ${TONES[state]}`}>${words.states[state]}</span>${until && html` <span class="small muted">${words.linkUntil(dateTime(until))}</span>`}`;
}

const Made = ({ made, onAgain }) => html`
  <${PageHead} title=${words.title}><button class="button" type="button" onClick=${onAgain}>${words.back}</button><//>
  ${made.left_out > 0 && html`<${Notice} tone="warn" title=${words.leftOut(made.left_out)} />`}
  ${made.invitations.length > 0 && html`<${MadeInvitations} invitations=${made.invitations} />`}`;

// A recording whose sender is gone: how much arrived, and what a person can do with it at once.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { clock } from '../../format.js';
import { go } from '../../router.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { Notice, ProblemNotice } from '../page/notice.js';

const words = t.watch.interrupted;

/** Shown while the session waits for its sender. @param {Props} props */
export function Interrupted({ session, watch }) {
  const [busy, setBusy] = useState(false);
  const [asking, setAsking] = useState(false);
  const [problem, setProblem] = useState(null);
  if (watch.state !== 'waiting') return null;
  const end = async () => {
    setBusy(true);
    setProblem(null);
    // The page follows the session, and shows it as it is scored.
    await api.sessions.end(session.id).catch(error => setProblem(asProblem(error)));
    setBusy(false);
  };
  const remove = () => api.sessions.remove(session.id).then(() => go(['sessions']));
  const [recorded, left] = [watch.interruption?.recorded_s ?? 0, watch.interruption?.ends_in_s ?? null];
  return html`
    <${Notice} tone="warn" title=${recorded > 0 ? words.at(clock(recorded, 0)) : words.title}>
      ${left !== null && html`<p>${words.body(Math.max(1, Math.ceil(left / 60)))}</p>`}
      <${ProblemNotice} problem=${problem} />
      <div class="row">
        <button class="button main" type="button" disabled=${busy} onClick=${end}>${busy ? words.busy : words.end}</button>
        <button class="button" type="button" onClick=${() => setAsking(true)}>${words.remove}</button>
      </div>
      ${asking && html`<${Confirm} title=${words.removeTitle} body=${words.removeBody} yes=${words.remove} no=${t.session.keep}
        onYes=${remove} onClose=${() => setAsking(false)} />`}
    <//>`;
}

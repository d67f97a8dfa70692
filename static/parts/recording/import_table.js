// Imports the path that another tracker measured, as a session without a video.
import { html, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Field } from '../forms/form.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { TargetNeeded } from './recording_target.js';

const words = t.importing;

/** `target`: trainee, task and box, as chosen on the page. */
export function ImportTable({ target }) {
  const [file, tracker, when] = [useRef(null), useRef(null), useRef(null)];
  /** @type {{ busy?: boolean, needs?: boolean, session?: Schemas['SessionResponse'], problem?: object }} */
  const untouched = {};
  const [state, setState] = useState(untouched);
  const send = async event => {
    event.preventDefault();
    if (!target.ids) return setState({ needs: true });
    const table = file.current.files[0];
    setState({ busy: true });
    const recorded_at = when.current.value ? new Date(when.current.value).toISOString() : undefined;
    const query = { ...target.ids, tracker: tracker.current.value.trim(), filename: table.name, recorded_at };
    try {
      setState({ session: await api.sessions.importTable(query, await table.text()) });
      file.current.value = '';
    } catch (error) {
      setState({ problem: asProblem(error) });
    }
    return undefined;
  };
  return html`
    <section class="card list">
      <details><summary>${words.title}</summary>
        <form class="stack" onSubmit=${send}>
          <p class="muted">${words.lead}</p>
          <div class="fields">
            <${Field} type="file" required label=${words.file} accept=".csv,text/csv" inputRef=${file} />
            <${Field} label=${words.tracker} hint=${words.trackerHint} required maxlength="40" inputRef=${tracker} />
            <${Field} type="datetime-local" label=${words.when} hint=${words.whenHint} inputRef=${when} />
          </div>
          ${state.needs && !target.ids && html`<${TargetNeeded} refused=${target.refused} />`}
          <${ProblemNotice} problem=${state.problem} />
          ${state.session && html`<${Notice} tone="good" title=${words.done}><a href=${href(['sessions', state.session.id])}>${words.open}</a><//>`}
          <div><button class="button main" type="submit" disabled=${state.busy}>${state.busy ? words.sending : words.send}</button></div>
        </form>
      </details>
    </section>`;
}

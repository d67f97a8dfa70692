// One task: its standard, the distribution of its values, its errors and their score, its skill model, its raters, and rescoring.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { focusSoon } from '../parts/forms/focus.js';
import { Announce, Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { ErrorsOfTask } from '../parts/tasks/errors.js';
import { RatersDialog } from '../parts/tasks/raters.js';
import { Rescorings } from '../parts/tasks/rescorings.js';
import { SkillModel } from '../parts/tasks/skill_model.js';
import { Spread } from '../parts/tasks/spread.js';
import { Standard, StandardHistory, standardInUse } from '../parts/tasks/standard.js';
import { StandardForm } from '../parts/tasks/standard_form.js';

const words = t.task;

async function load(id, signal) {
  const task = await api.tasks.get(id, signal);
  const [standards, presets, features, cohorts] = await Promise.all([
    api.tasks.standards(task.id, signal), api.tasks.presets(task.id, signal), api.features(signal), api.cohorts.all()]);
  return { task, standards, presets, features, cohorts };
}

/** @param {Props} props */
export default function TaskPage({ person, route }) {
  const { id } = route.params;
  const { data, problem, reload } = useData(signal => load(id, signal), [id]);
  const [form, setForm] = useState(null); // Initial content of the form; null while it is closed.
  const [savedVersion, setSavedVersion] = useState(null);
  if (!data)
    return html`<${PageHead} title=${t.nav.tasks} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const { task, standards } = data;
  const isAdministrator = may(person, 'people');
  const open = first => (setSavedVersion(null), setForm({ first }));
  const close = () => (setForm(null), focusSoon('standard-in-use'));
  const finish = standard => (close(), setSavedVersion(standard.version), reload());
  return html`
    <${PageHead} title=${task.name} lead=${task.description}>
      <a class="button" href=${href(['tasks'])}>${words.all}</a>
      <a class="button" href=${href(['sessions'], { task: task.id })}>${words.sessions}</a>
    <//>
    <div class="stack">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      <${Announce}>${savedVersion ? t.standardForm.isSet(savedVersion) : ''}<//>
      ${savedVersion && html`<${Notice} tone="good" quiet title=${t.standardForm.isSet(savedVersion)} />`}
      ${form ? html`<${StandardForm} data=${data} first=${form.first} mayMake=${isAdministrator} onSet=${finish}
        onCancel=${close} />` : html`<${Standard} standard=${standardInUse(standards)} onSet=${task.may_change && (() => open(null))} />`}
      <${Spread} data=${data} onTake=${task.may_change && open} />
      <${ErrorsOfTask} key=${task.id} task=${task} person=${person} />
      <${OtherSections} task=${task} standards=${standards} person=${person} />
    </div>`;
}

/** @param {Props} props */
function OtherSections({ task, standards, person }) {
  const [showsRaters, setShowsRaters] = useState(false);
  return html`
    <div class="columns">
      <section class="card">
        <header><h2>${words.model}</h2></header>
        <div class="body row"><${SkillModel} task=${task} mayTrain=${may(person, 'people')} /></div>
      </section>
      <section class="card">
        <header><h2>${words.raters}</h2><button class="button" type="button"
          aria-label=${t.raters.title(task.name)} onClick=${() => setShowsRaters(true)}>${t.raters.open}</button></header>
        <div class="body muted">${words.ratersBody}</div>
      </section>
      <${StandardHistory} standards=${standards.filter(one => one !== standardInUse(standards))} />
    </div>
    ${may(person, 'people') && html`<${Rescorings} task=${task} />`}
    ${showsRaters && html`<${RatersDialog} task=${task} onClose=${() => setShowsRaters(false)} />`}`;
}

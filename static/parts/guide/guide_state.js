// The first steps of a new centre: what is done, what is next, and the page that does it.
import { useEffect } from '../../preact.js';
import { api, onChanged } from '../../api.js';
import { useData } from '../../data.js';

/** The first steps, read again after each change and when `deps` change. @param {unknown[]} deps */
export function useFirstSteps(deps) {
  const { data, problem, reload } = useData(signal => api.firstSteps(signal), deps);
  useEffect(() => onChanged(reload), []);
  return { data, problem, reload };
}

/**
 * The page that does a step.
 *
 * @param {Schemas['FirstStepKind']} step
 * @param {Schemas['FirstSteps']} guide
 */
export function pathOf(step, { box_to_set_up: box }) {
  if (step === 'box_setup') return box ? ['boxes', box, 'setup'] : ['boxes'];
  return { password: ['account'], centre: ['centre'], group: ['groups'], task: ['tasks'], box: ['boxes'], people: ['enrol'], recording: ['record'] }[step];
}

/** The step to do next. @param {Schemas['FirstSteps']} guide */
export const nextStep = ({ steps }) => steps.find(one => !one.is_done)?.step ?? null;

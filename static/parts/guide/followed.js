// Whether the person follows the guide through the first steps, and whether they have hidden it on Today.
import { useEffect, useState } from '../../preact.js';

/** Storage may be refused (private window): the guide then forgets, and works. */
const read = (storage, key) => {
  try {
    return storage().getItem(key);
  } catch {
    return null;
  }
};
const write = (storage, key, value) => {
  try {
    if (value === null) storage().removeItem(key);
    else storage().setItem(key, value);
  } catch {
    // Forgotten.
  }
};
const ofBrowser = () => localStorage;
const ofTab = () => sessionStorage;
const FOLLOWED = 'trocar.guide';
const CHANGED = 'trocar:guide';

const hiddenKey = person => `trocar.guide.hidden.${person.id}`;

/** Whether the person has hidden the guide on *Today* of this browser. */
export function useHidden(person) {
  const [isHidden, setHidden] = useState(() => read(ofBrowser, hiddenKey(person)) === 'yes');
  const hide = value => {
    write(ofBrowser, hiddenKey(person), value ? 'yes' : null);
    setHidden(value);
  };
  return /** @type {const} */ ([isHidden, hide]);
}

/** Whether the person follows the guide in this tab: each page then shows the way on. */
export function followGuide(isFollowed) {
  write(ofTab, FOLLOWED, isFollowed ? 'yes' : null);
  dispatchEvent(new Event(CHANGED));
}

export function useFollowed() {
  const isFollowed = () => read(ofTab, FOLLOWED) === 'yes';
  const [shown, setShown] = useState(isFollowed);
  useEffect(() => {
    const change = () => setShown(isFollowed());
    addEventListener(CHANGED, change);
    return () => removeEventListener(CHANGED, change);
  }, []);
  return shown;
}

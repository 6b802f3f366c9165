// Whether a page that loads itself again is still written: says so once it has been silent for too long.

const stale = /** @type {HTMLElement} */ (document.getElementById("stale"));
const age = /** @type {HTMLElement} */ (document.getElementById("age"));

const look = () => {
  const silent_s = (Date.now() - Number(stale.dataset.writtenMs)) / 1000;
  age.textContent = silent_s < 7200 ? `${Math.round(silent_s / 60)} min` : `${Math.round(silent_s / 3600)} h`;
  stale.hidden = silent_s < Number(stale.dataset.patienceS);
};
look();
setInterval(look, 1000);

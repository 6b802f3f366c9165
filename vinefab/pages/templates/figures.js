// Buttons of a page's figures, and what is folded: opened to print. PDF is the browser's print of one figure.

/** @param {Element} place @param {string} text @param {() => void} act */
const button = (place, text, act) => {
  const made = document.createElement("button");
  made.textContent = text;
  made.onclick = act;
  place.append(" ", made);
  return made;
};

for (const figure of document.querySelectorAll("figure")) {
  const image = figure.querySelector("img");
  const caption = figure.querySelector("figcaption");
  if (!image || !caption) continue;
  const place = document.createElement("span");
  caption.prepend(place);
  const kind = image.src.startsWith("data:image/png") ? "png" : "svg";
  const name = image.dataset.file || image.alt.slice(0, 40).replace(/[^A-Za-z0-9]+/g, "_").replace(/_$/, "");
  button(place, kind.toUpperCase(), () => {
    const link = document.createElement("a");
    link.href = image.src;
    link.download = `${name}.${kind}`;
    link.click();
  });
  // On a narrow window a picture is as wide as the page, or scrolls at its own size.
  const full = button(place, "Full size", () => {
    full.setAttribute("aria-pressed", String(figure.classList.toggle("full")));
  });
  full.className = "narrow";
  full.setAttribute("aria-pressed", "false");
  button(place, "PDF", () => {
    const root = document.documentElement.classList;
    root.add("alone");
    figure.classList.add("only");
    print();
    root.remove("alone");
    figure.classList.remove("only");
  });
}

const folded = () => /** @type {HTMLDetailsElement[]} */ ([...document.querySelectorAll("details:not([open])")]);
const first = document.querySelector("main > details");
if (first) {
  const place = document.createElement("p");
  first.before(place);
  button(place, "Open everything below", () => { for (const one of folded()) one.open = true; });
}
let closed = /** @type {HTMLDetailsElement[]} */ ([]);
addEventListener("beforeprint", () => {
  closed = folded();
  for (const one of closed) one.open = true;
});
addEventListener("afterprint", () => { for (const one of closed) one.open = false; });

// Light and dark: what the system says, or what was chosen here; colours are those of style.css.

const dark = matchMedia("(prefers-color-scheme: dark)");
const CHOICES = ["system", "light", "dark"];
const heard = new Set();
const known = new Map(); // values of style.css, which take some microseconds each to be read

function stored() {
  try {
    return localStorage.getItem("theme");
  } catch {
    return null; // a file without a place to store anything
  }
}

let choice = CHOICES.includes(stored()) ? stored() : "system";

const printing = new Set(); // who prints: paper is light until the last of them ends
const shown = () => (printing.size === 0 && (choice === "dark" || (choice === "system" && dark.matches)) ? "dark" : "light");

function apply() {
  known.clear();
  document.documentElement.dataset.theme = shown();
  for (const listener of heard) listener();
}

export const theme = {
  get choice() {
    return choice;
  },
  next() {
    choice = CHOICES[(CHOICES.indexOf(choice) + 1) % CHOICES.length];
    try {
      localStorage.setItem("theme", choice);
    } catch {
      // It holds for this visit.
    }
    apply();
  },
  // `by` begins or ends to print; an end that somebody else reports leaves the colours of paper.
  forPaper(by, isPaper) {
    if (printing.has(by) === isPaper) return;
    const was = document.documentElement.dataset.theme;
    if (isPaper) printing.add(by);
    else printing.delete(by);
    if (was !== shown()) apply();
  },
  onChange(listener) {
    heard.add(listener);
  },
};

// A colour, or another value, by its name in style.css.
export function colour(name) {
  if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return known.get(name);
}

// A font of the type scale: "small", "text" or "large".
export const font = (size, weight = 400) => `${weight} ${colour(size)} ${colour("font")}`;

dark.addEventListener("change", apply);
apply();

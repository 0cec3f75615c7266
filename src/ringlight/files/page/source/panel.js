// What stands beside the picture: faders, layers, stops, help.
const element = (id) => document.getElementById(id);

export class Panel {
  // `viewed(name)` goes to a stop, `looked(change)` changes what is shown, `flew(flies)` the way to move.
  constructor(facts, stops, { viewed, looked, flew }) {
    Object.assign(this, { names: [...stops.keys()], at: 0, viewed, looked });
    const chooser = element("stops");
    for (const name of this.names) chooser.append(new Option(name.replace("train-", "training camera "), name));
    chooser.addEventListener("change", () => this.go(chooser.selectedIndex));
    element("before").addEventListener("click", () => this.go(this.at - 1));
    element("after").addEventListener("click", () => this.go(this.at + 1));
    element("home").addEventListener("click", () => this.go(0));
    element("light").addEventListener("input", () => this.fade(Number(element("light").value)));
    element("light-row").hidden = !facts.lit;
    const lights = facts.lights ?? [];
    element("blend-row").hidden = !lights.length;
    lights.forEach((name, number) => element("packs").append(new Option(name, number)));
    element("packs").addEventListener("change", () => this.blend(Number(element("blend").value)));
    element("blend").addEventListener("input", () => this.blend(Number(element("blend").value)));
    for (const choice of document.getElementsByName("layer")) {
      choice.addEventListener("change", () => looked({ layer: choice.value }));
    }
    element("fly").addEventListener("change", () => flew(element("fly").checked));
    element("help").addEventListener("click", () => this.help());
    element("fold").addEventListener("click", () => this.fold());
    element("theme").addEventListener("click", () => this.theme());
    addEventListener("keydown", (event) => this.keyed(event));
    if (matchMedia("(max-width: 40rem)").matches) this.fold();
  }

  go(index) {
    this.show(this.names[(index + this.names.length) % this.names.length]);
    this.viewed(this.names[this.at]);
  }

  // Name a stop, without going there.
  show(name) {
    element("stops").selectedIndex = this.at = Math.max(this.names.indexOf(name), 0);
  }

  fade(amount) {
    element("light").value = String(amount);
    element("light-value").textContent = amount.toFixed(2);
    this.looked({ residual: amount });
  }

  // This share of a pack's light in place of the model's own.
  blend(share, pack = Math.max(element("packs").selectedIndex, 0)) {
    element("packs").selectedIndex = pack;
    element("blend").value = String(share);
    element("blend-value").textContent = share.toFixed(2);
    this.looked({ pack, blend: share });
  }

  layer(name) {
    for (const choice of document.getElementsByName("layer")) choice.checked = choice.value === name;
    this.looked({ layer: name });
  }

  help() {
    const dialog = element("keys");
    if (dialog.open) dialog.close();
    else dialog.showModal();
  }

  fold() {
    const folded = element("panel").classList.toggle("folded");
    element("fold").setAttribute("aria-expanded", String(!folded));
  }

  theme() {
    const root = document.documentElement,
      dark = matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = (root.dataset.theme ?? (dark ? "dark" : "light")) === "dark" ? "light" : "dark";
  }

  keyed(event) {
    if (
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      (event.target instanceof HTMLElement && event.target.matches("select"))
    )
      return;
    const light = Number(element("light").value);
    const deeds = {
      "?": () => this.help(),
      h: () => this.go(0),
      n: () => this.go(this.at + 1),
      p: () => this.go(this.at - 1),
      1: () => this.layer("picture"),
      2: () => this.layer("base"),
      3: () => this.layer("normals"),
      4: () => this.layer("depth"),
      "+": () => this.fade(Math.min(light + 0.1, 2)),
      "-": () => this.fade(Math.max(light - 0.1, 0)),
      0: () => this.fade(1),
      l: () => element("blend-row").hidden || this.blend(Number(element("blend").value) < 0.5 ? 1 : 0),
      f: () => element("fly").click(),
      c: () => this.fold(),
      t: () => this.theme(),
    };
    deeds[event.key.toLowerCase()]?.();
  }
}

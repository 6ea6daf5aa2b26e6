for (const figure of document.querySelectorAll("figure.poses")) {
  const svg = figure.querySelector("svg"), groups = [...svg.querySelectorAll("g")];
  const [x0, y0, z0, scale, ...start] = svg.dataset.view.split(" ").map(Number);
  const items = [...svg.querySelectorAll("[data-p]")].map(item =>
    [item, Number(item.dataset.each), item.dataset.p.split(" ").map(Number)]);
  let [turn, tilt] = start, waiting = false, from = null;
  const draw = () => {
    waiting = false;
    const a = turn * Math.PI / 180, e = tilt * Math.PI / 180;
    const ca = Math.cos(a), sa = Math.sin(a), ce = Math.cos(e), se = Math.sin(e);
    for (const [item, each, p] of items) {
      let d = "";
      for (let i = 0; i < p.length; i += 3) {
        const x = p[i] - x0, y = p[i + 1] - y0, z = p[i + 2] - z0;
        const u = (scale * (ca * y - sa * x)).toFixed(1), v = (scale * (se * (ca * x + sa * y) - ce * z)).toFixed(1);
        if (each) d += (i / 3 % each ? "L" : "M") + u + " " + v + (each === 1 ? "h0" : "");
        else { item.setAttribute("x", u); item.setAttribute("y", v); }
      }
      if (each) item.setAttribute("d", d);
    }
  };
  const look = (to, up) => {
    turn = to; tilt = Math.max(-90, Math.min(90, up));
    if (!waiting) { waiting = true; requestAnimationFrame(draw); }
  };
  svg.tabIndex = 0;
  figure.classList.add("live");
  svg.addEventListener("pointerdown", event => {
    from = [event.clientX, event.clientY, turn, tilt];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", event => {
    if (from) look(from[2] - (event.clientX - from[0]) / 2, from[3] + (event.clientY - from[1]) / 2);
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { from = null; });
  svg.addEventListener("keydown", event => {
    const step = { ArrowLeft: [5, 0], ArrowRight: [-5, 0], ArrowUp: [0, -5], ArrowDown: [0, 5] }[event.key];
    if (event.altKey || event.ctrlKey || event.metaKey || !(step || event.key === "Home")) return;
    event.preventDefault();
    if (step) look(turn + step[0], tilt + step[1]); else look(...start);
  });
  const buttons = [...figure.querySelectorAll("button")];
  buttons.forEach((button, mine) => button.addEventListener("click", () => {
    const alone = button.getAttribute("aria-pressed") !== "true";
    buttons.forEach((other, i) => other.setAttribute("aria-pressed", alone && i === mine));
    groups.forEach((group, i) => group.classList.toggle("off", alone && i !== mine));
  }));
}

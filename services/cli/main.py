"""The process entry of the command `nerfmodal`: every command, a file per group."""

import typer

from services.cli import (
    certificate,
    compare,
    demo,
    doctor,
    fleet,
    keys,
    local,
    operate,
    plants,
    preflight,
    presets,
    reproduce,
    scans,
    up,
    worker,
)
from services.cli.outcomes import Commands

app = typer.Typer(
    name="nerfmodal",
    cls=Commands,
    help="Natural frequencies, damping and mode shapes of plants and structures, from pictures or point clouds.",
    epilog="Start with: nerfmodal demo --spec examples/acai.yaml --out out/demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
app.command(epilog="Example: nerfmodal run examples/acai.yaml --out out/acai")(local.run)
app.command(epilog="Example: nerfmodal simulate examples/acai.yaml --out out/capture")(local.simulate)
app.command(epilog="Example: nerfmodal reconstruct ../captures/fox --out out/fox --downscale 4")(local.reconstruct)
app.command(epilog="Example: nerfmodal identify out/clouds --out out/modes")(local.identify)
app.command(epilog="Example: nerfmodal compare out/demo out/demo/truth.npz")(compare.compare)
app.command(epilog="Example: nerfmodal demo --spec examples/acai.yaml --out out/demo")(demo.demo)
app.command("preflight", epilog="Example: nerfmodal preflight examples/acai.yaml")(preflight.look_ahead)
app.command(epilog="Example: nerfmodal certify captures/today --out out/certificate")(certificate.certify)
app.command(epilog="Example: nerfmodal demo-fleet --plants 200 --scans 25")(fleet.demo_fleet)
app.command(epilog="Example: nerfmodal up --port 8000 --data .nerfmodal --captures /data/captures")(up.up)
app.command(epilog="Example: nerfmodal worker --queues train,extract --slots 2")(worker.worker)
app.command(epilog="Example: nerfmodal migrate")(worker.migrate)
app.command(epilog="Example: nerfmodal fsck")(operate.fsck)
app.command(epilog="Example: nerfmodal doctor")(doctor.doctor)
app.command(epilog="Example: nerfmodal presets quick > quick.yaml")(presets.presets)
app.add_typer(scans.app, name="scans")
app.add_typer(reproduce.app, name="reproduce")
app.add_typer(plants.app, name="plants")
app.add_typer(keys.app, name="keys")
app.add_typer(operate.app, name="workers")


def main() -> None:
    """Run the command line; exit codes 0 done, 1 failed, 2 wrong usage, 3 invalid input."""
    app()


if __name__ == "__main__":
    main()

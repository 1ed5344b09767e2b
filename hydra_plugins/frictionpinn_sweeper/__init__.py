"""Hydra finds its plugins under this name; the sweeper itself is :mod:`frictionpinn.workflow.sweep`."""

from __future__ import annotations

from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser

from frictionpinn.errors import UserError
from frictionpinn.workflow import cli


class ResumableSweeper(BasicSweeper):
    """Hydra's basic sweeper with a manifest: finished jobs are skipped, stopped ones go on, all are summarised."""

    def sweep(self, arguments: list[str]) -> Any:
        from frictionpinn.workflow.sweep import Sweep

        assert self.config is not None and self.launcher is not None and self.hydra_context is not None
        given = [*self._parse_config(), *arguments]
        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        parsed = parser.parse_overrides(given)
        swept = list(dict.fromkeys(item.get_key_element() for item in parsed if item.is_sweep_override()))
        batches = self.split_arguments(parsed, self.max_batch_size)
        combinations = [list(overrides) for batch in batches for overrides in batch]

        def compose(overrides: list[str]):
            return self.hydra_context.config_loader.load_sweep_config(self.config, overrides)

        try:
            sweep = Sweep(self.config, arguments, swept, combinations, compose)
            return sweep.run(self.launcher, self.max_batch_size or len(combinations))
        except UserError as error:
            if cli.full_error():
                raise
            cli.fail(error)
            raise SystemExit(cli.USER_ERROR) from error

"""Stages that turn the unfiltered contact wrench into the published one."""

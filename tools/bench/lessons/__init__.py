"""Measurements that belong to one lesson."""

@echo off
rem Start Strata on Windows. The first use sets everything up, and so does the first after a change of the packages:
rem that is done by bootstrap\, in Python. Any later use goes straight to the command line in .venv.
setlocal
set "root=%~dp0"
if "%root:~-1%"=="\" set "root=%root:~0,-1%"
set "python=%root%\.venv\Scripts\python.exe"
rem Another Python's; its packages would hide ours of the same name.
set "PYTHONHOME="
set "PYTHONPATH="

for %%o in (--yes --no-install --extras --latest --from) do if "%~1"=="%%o" goto setup

rem The same question as Environment.ready in bootstrap\environment.py.
if not exist "%python%" goto setup
set "home="
set "extent="
set "graphics="
(set /p home= & set /p extent= & set /p graphics=) 2>nul <"%root%\.venv\strata.stamp"
if not "%home%"=="%root%" goto setup
if /i "%CI%"=="true" if not "%extent% %graphics%"=="all complete" goto setup
if not "%graphics%"=="found" if not "%graphics%"=="complete" goto setup
fc /b "%root%\requirements.lock" "%root%\.venv\requirements.lock" >nul 2>nul || goto setup
"%python%" -P -m chapters %*
exit /b

:setup
set "candidate="
for %%p in ("py -3" python python3) do (
    if not defined candidate (
        %%~p -I -c "import sys; sys.exit(sys.version_info < (3, 11))" >nul 2>nul && set "candidate=%%~p"
    )
)
rem Outside of the loop: a parenthesis in the user's words would end its block.
if defined candidate goto python
where uv >nul 2>nul && goto uv
echo strata: Strata needs Python 3.11 or newer, and found none: winget install Python.Python.3.13 >&2
exit /b 2

:python
%candidate% -I "%root%\bootstrap\__main__.py" %*
exit /b

:uv
uv run --quiet --no-project --python ">=3.11" python -I "%root%\bootstrap\__main__.py" %*
exit /b
